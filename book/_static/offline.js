// Excerpts beside search results are fetched from the pages, which a browser refuses from disk.
DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = location.protocol.startsWith("http");
