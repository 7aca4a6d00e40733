"""Surface EMG: processing, a person's calibration, and the law `emg-activation`."""
