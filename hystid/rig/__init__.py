"""A rig that recordings are held against: what it must have, where its mass stands, and where its fits begin."""
