"""What a planning cycle solved, to be read, kept and solved again."""
