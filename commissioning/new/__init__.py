"""A profile of one's own: from a template, or from a robot's URDF."""
