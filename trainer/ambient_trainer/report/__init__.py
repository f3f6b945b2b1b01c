"""What people read: tables for the terminal and the page, plots, and a page that needs no network."""
