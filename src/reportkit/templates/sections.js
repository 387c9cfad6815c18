// Names the section of each search result and quotes the words around the first hit. SECTIONS stands
// above, since a browser does not read the pages themselves from disk.
const words = (new URLSearchParams(location.search).get("q") ?? "")
  .toLowerCase()
  .split(/[^\p{L}\p{N}_]+/u)
  .filter(Boolean);
const hits = (text) => words.filter((word) => text.toLowerCase().includes(word)).length;

function nameSection(item) {
  const link = item.querySelector("a");
  const root = new URL(document.documentElement.dataset.content_root ?? "./", location);
  const [page, anchor] = link.href.slice(root.href.length).split("#");
  const sections = SECTIONS[page.replace(/\.html.*$/, "")] ?? [];
  let best = sections.find(([id]) => id === anchor);
  for (const section of anchor ? [] : sections) {
    if (hits(section[1] + section[2]) > (best ? hits(best[1] + best[2]) : 0)) best = section;
  }
  if (!best) return;
  const [id, title, text] = best;
  if (!anchor && best !== sections[0]) {
    const place = document.createElement("a");
    place.href = `${link.href.replace(/\?.*$/, "")}#${id}`;
    place.textContent = title;
    link.after(" › ", place);
  }
  const found = words.map((word) => text.toLowerCase().indexOf(word)).filter((at) => at >= 0);
  if (found.length && !item.querySelector(".context")) {
    const start = text.lastIndexOf(" ", Math.max(0, Math.min(...found) - 80)) + 1;
    const excerpt = document.createElement("p");
    excerpt.className = "context";
    excerpt.textContent = (start ? "… " : "") + text.slice(start, start + 220).replace(/\S*$/, "…");
    item.append(excerpt);
  }
}

document.addEventListener("DOMContentLoaded", () => {
  const results = document.getElementById("search-results");
  new MutationObserver((changes) => {
    for (const { addedNodes } of changes) {
      for (const item of addedNodes) if (item.nodeName === "LI") nameSection(item);
    }
  }).observe(results, { childList: true, subtree: true });
});
