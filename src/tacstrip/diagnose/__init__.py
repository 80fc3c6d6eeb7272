"""What is wrong with the hardware, from its readings alone.

The names that this package gives are listed in `__init__.pyi`, once, and loaded when first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
