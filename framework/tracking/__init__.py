"""From observations to tracks: history, resampling, recordings, noise."""
