from .doctor import diagnose as diagnose
from .faults import FAULTS as FAULTS
from .faults import Finding as Finding
from .faults import Report as Report
from .log import Log as Log
from .log import read_log as read_log
