"""Parts of the speed study."""
