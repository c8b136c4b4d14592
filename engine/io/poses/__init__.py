"""Camera poses of other programs."""
