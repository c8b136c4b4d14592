"""Qt windows and pages: they show state and emit intent, and hold no logic."""
