"""What the solver reads: observations, pyramids of photographs, initial maps."""
