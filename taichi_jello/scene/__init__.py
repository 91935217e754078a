"""What a person asks for, checked; and the Body that it becomes. NumPy only."""
