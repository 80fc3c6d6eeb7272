"""Regular outlines that explain the readings of one signature: see `draws.py`."""
