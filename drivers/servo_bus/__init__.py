"""What buses of serial servos share that have registers, status packets and 4096 counts a turn: Dynamixel, Feetech."""
