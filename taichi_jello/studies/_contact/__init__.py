"""Parts of the study of contact."""
