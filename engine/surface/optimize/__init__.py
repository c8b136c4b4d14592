"""Per-pixel optimisation, and the priors between pixels."""
