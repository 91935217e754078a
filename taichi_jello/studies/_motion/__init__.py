"""Parts of the motion study."""
