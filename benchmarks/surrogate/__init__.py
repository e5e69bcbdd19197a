"""What a network costs as an FMU."""
