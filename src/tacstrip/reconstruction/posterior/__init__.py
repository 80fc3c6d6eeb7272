"""How sure a shape is: outlines drawn as often as the readings make them likely, compared with the one returned."""
