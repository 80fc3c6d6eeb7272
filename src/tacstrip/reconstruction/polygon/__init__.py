"""The polygon fit: all strips at once by least squares, the number of vertices found."""
