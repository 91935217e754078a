"""Contact with colliders."""
