"""Springs: Hooke and dashpot, packed, changing, tearing."""
