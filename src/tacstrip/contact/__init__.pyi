from .signature import geometric_centre as geometric_centre
from .signature import pseudo_centres as pseudo_centres
