"""What every controller shares: command limits, velocity smoother, what a policy sees."""
