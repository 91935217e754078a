"""Fast impacts of jellos."""
