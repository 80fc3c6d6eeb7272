"""CRS-CRP as a network: mesh, scan, inversion and error bound."""
