from .cramer_rao import reading_sigma as reading_sigma
from .profile import profile_at as profile_at
