"""Where a point of the sensor lies in space: (strip, y) to a curved skin and back."""
