"""The view in space: what it shows, the process that draws it, and the watch over that process. No Qt."""
