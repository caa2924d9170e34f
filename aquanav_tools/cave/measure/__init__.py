"""What a caver measures: sections and statistics."""
