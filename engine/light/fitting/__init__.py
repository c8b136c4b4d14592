"""Stage *light*: Gaussians and lamps fitted to the background."""
