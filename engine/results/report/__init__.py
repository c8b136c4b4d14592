"""The report: one page about one result."""
