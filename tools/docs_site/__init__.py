"""What the site takes from the package while it is built: commands, transcripts, the reproduced tables."""
