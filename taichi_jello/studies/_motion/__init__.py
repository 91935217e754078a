"""Parts of the study of motion."""
