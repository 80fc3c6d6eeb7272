"""Logs of anybody's form: read as a table, their columns guessed with a reason each, and written as readings."""
