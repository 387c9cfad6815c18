"""Parts that only this book needs: drawings, peers, names and styles."""
