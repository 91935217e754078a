"""From a state to what is drawn."""
