"""The paper's Monte Carlo renderer: sampling, queries of the light, shadows."""
