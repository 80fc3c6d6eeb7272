"""Objects with three dimensions, pressed into a skin."""
