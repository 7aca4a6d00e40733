"""Evaluates user studies: questionnaires, surface EMG, trials, statistics, tables and boxplots."""
