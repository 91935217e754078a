"""What can be touched."""
