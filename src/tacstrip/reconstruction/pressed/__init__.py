"""Which object was pressed into a skin, from one scan: `fit_solid`."""
