"""How the camera turned between shots, while capturing."""
