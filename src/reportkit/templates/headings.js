// The printed headings in the order of the outline. A formula among the words is taken from its MathML.
() => [...document.querySelectorAll('h1, h2, h3, h4, h5, h6')]
  .filter(heading => heading.checkVisibility()).map(heading => {
    const copy = heading.cloneNode(true);
    copy.querySelectorAll('.headerlink, svg').forEach(part => part.remove());
    return copy.textContent.replace(/\s+/g, ' ').trim();
  })
