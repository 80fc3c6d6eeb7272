"""Chapter 5: simulations, tables 5.2-5.14 and their figures."""
