"""The BRDF, as a kernel and in torch."""
