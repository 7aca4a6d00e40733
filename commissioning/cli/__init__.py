"""The commands of commissioning: `srl calibrate`, `jog`, `new`, `find-port`."""
