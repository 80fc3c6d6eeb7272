"""Sensors that strip sensors are measured against: four-wire sheet and digital array."""
