"""FMUs (functional mock-up units): what they declare, and their files."""
