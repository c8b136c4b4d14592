"""What leaves the program: exports, metrics, preview images, the report."""
