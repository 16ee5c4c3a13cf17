"""Memory, time and error against minutes of data: what grows, how fast, and what does not."""
