"""Parts of the study of accuracy."""
