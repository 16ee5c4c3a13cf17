"""What a database holds, and what of it a recorded run met: tables, pictures, one page."""
