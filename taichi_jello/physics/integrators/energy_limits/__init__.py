"""What keeps steps from feeding energy."""
