"""The study that compares controllers of Nav2 with ours."""
