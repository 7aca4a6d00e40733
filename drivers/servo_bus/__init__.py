"""What buses of serial servos share, whatever their maker: the line, requests, goals, faults, units."""
