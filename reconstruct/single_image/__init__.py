"""From one ordinary image: illuminant, lobes, shape, light and parameters."""
