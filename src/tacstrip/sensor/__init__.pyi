from .channel import Channel as Channel
from .closed_form import lower_and_width as lower_and_width
from .closed_form import lower_from_width as lower_from_width
from .closed_form import width_from_lower as width_from_lower
from .converter import Converter as Converter
from .raw import apply_calibration as apply_calibration
from .raw import invert_calibration as invert_calibration
