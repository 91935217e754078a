"""Parts of the accuracy study."""
