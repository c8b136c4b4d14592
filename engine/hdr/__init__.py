"""Stage *hdr*: brackets of RAW files, or linear images, become linear radiance."""
