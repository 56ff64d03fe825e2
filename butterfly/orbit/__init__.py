"""Large orbits: hold one by energy shaping, and analyse how it is approached."""
