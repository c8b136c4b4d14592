"""The light that arrives at the object: probes, directions, and what no photograph covers."""
