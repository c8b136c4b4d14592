"""The Gaussians and how they are rendered."""
