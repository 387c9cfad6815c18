// Excerpts beside search results are fetched from the pages, which a browser refuses from disk.
DOCUMENTATION_OPTIONS.SHOW_SEARCH_SUMMARY = location.protocol.startsWith("http");

// The arrow that unfolds a part of the contents has no text of its own.
document.addEventListener("DOMContentLoaded", () => {
  for (const arrow of document.querySelectorAll(".bd-links summary")) {
    arrow.setAttribute("aria-label", "Show or hide the pages below");
  }
});

// What scrolls sideways is to be reached by the keyboard, like the tables and the code of the theme.
const reach = () => {
  for (const wide of document.querySelectorAll("figure.plan, dt.sig")) {
    wide.tabIndex = wide.scrollWidth > wide.clientWidth ? 0 : -1;
  }
};
addEventListener("load", reach);
addEventListener("resize", reach);
