"""Pages in the browser, and the processes that serve them."""
