"""The steps of stiff jellos."""
