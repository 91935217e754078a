"""What a film can be written as: one file a format, found by looking here."""
