"""From what is drawn to a picture."""
