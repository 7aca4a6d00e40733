"""Pictures of a recording and of a profile: figures, films, stills, wiring."""
