"""Looks at each shot while a session is being captured; `watch.Watch` is the one object to feed."""
