"""What is wrong with the hardware, told from readings alone."""
