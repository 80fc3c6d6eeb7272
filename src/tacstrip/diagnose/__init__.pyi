from .doctor import diagnose as diagnose
from .faults import FAULTS as FAULTS
from .faults import Finding as Finding
from .faults import Report as Report
from .learned_noise import LearnedNoise as LearnedNoise
from .learned_noise import learn_noise as learn_noise
from .log import Log as Log
from .log import read_log as read_log
