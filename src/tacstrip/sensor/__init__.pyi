from .channel import Channel as Channel
from .circuit import lower_and_width as lower_and_width
from .circuit import lower_from_width as lower_from_width
from .circuit import width_from_lower as width_from_lower
from .raw import apply_calibration as apply_calibration
from .raw import invert_calibration as invert_calibration
