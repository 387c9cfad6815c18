// The page Explorer: draws the case that the sliders choose, from the table that the page carries.
"use strict";
(() => {
  const root = document.querySelector(".explorer");
  if (!root) return; // every page loads this, the book as one page as well
  const table = JSON.parse(document.getElementById("explorer-data").textContent);
  const names = Object.keys(table.grid);
  const unpack = (text) => {
    const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
    const view = new DataView(bytes.buffer);
    return Int16Array.from({ length: bytes.length / 2 }, (_, n) => view.getInt16(2 * n, true));
  };
  const counts = unpack(table.counts);
  const points = unpack(table.points);
  const starts = [0];
  counts.forEach((count, n) => starts.push(starts[n] + 2 * count));

  const place = (at) => names.reduce((n, name) => n * table.grid[name].length + at[name], 0);
  const curve = (at, k) => {
    const n = place(at) * table.curves.length + k;
    return Array.from({ length: counts[n] }, (_, m) => [
      points[starts[n] + m] * table.tick,
      points[starts[n] + counts[n] + m] * table.scale[k],
    ]);
  };

  const W = 620, H = 190, LEFT = 52, TOP = 26, BOTTOM = 22, LAST = 20;
  const TITLES = ["velocity / (m/s)", "motor current / A", "gear force / N"];
  const made = (name, attributes, parent, text = "") => {
    const node = document.createElementNS("http://www.w3.org/2000/svg", name);
    Object.entries(attributes).forEach(([key, value]) => node.setAttribute(key, value));
    node.textContent = text;
    return parent.appendChild(node);
  };
  // Round numbers that span an interval in so many steps or somewhat fewer.
  const ticks = (low, high, wanted = 4) => {
    const rough = (high - low) / wanted;
    const power = 10 ** Math.floor(Math.log10(rough));
    const step = power * [1, 2, 5, 10].find((factor) => factor * power >= rough);
    const first = Math.ceil(low / step - 1e-9);
    const last = Math.floor(high / step + 1e-9);
    return Array.from({ length: last - first + 1 }, (_, n) => (first + n) * step);
  };
  const told = (value, digits = 3) =>
    (Math.abs(value) < 1e-12 ? 0 : Number(value.toPrecision(digits))).toString().replace("-", "−");

  const plots = TITLES.map((title, k) => {
    const svg = made("svg", { viewBox: `0 0 ${W} ${H + (k === 2 ? LAST : 0)}`, role: "img", "aria-label": `${title} against time; the numbers stand in the table below` }, root.querySelector(".plots"));
    const axes = made("g", {}, svg);
    const old = made("path", { class: "curve published" }, svg);
    const now = made("path", { class: "curve chosen", "data-curve": table.curves[k] }, svg);
    made("text", { x: 0, y: 14 }, svg, title);
    if (k === 2) made("text", { x: (LEFT + W) / 2, y: H + LAST - 6, "text-anchor": "middle" }, svg, "time / s");
    return (at) => {
      const both = [curve(table.published, k), curve(at, k)];
      const values = both.flat().map((point) => point[1]);
      const [low, high] = [Math.min(0, ...values), Math.max(...values)];
      const x = (t) => LEFT + ((W - LEFT - 8) * t) / table.t_end;
      const y = (v) => TOP + ((H - TOP - BOTTOM) * (high - v)) / (high - low);
      const path = (line) => "M" + line.map(([t, v]) => `${x(t).toFixed(1)},${y(v).toFixed(1)}`).join("L");
      axes.replaceChildren();
      for (const v of ticks(low, high)) {
        made("line", { class: "grid", x1: LEFT, x2: W - 8, y1: y(v), y2: y(v) }, axes);
        made("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, axes, told(v));
      }
      for (const t of ticks(0, table.t_end, 6)) {
        made("text", { x: x(t), y: H - 4, "text-anchor": "middle" }, axes, told(t));
      }
      old.setAttribute("d", path(both[0]));
      now.setAttribute("d", path(both[1]));
    };
  });

  const inputs = Object.fromEntries(names.map((name) => [name, root.querySelector(`input[name=${name}]`)]));
  const chosen = () => Object.fromEntries(names.map((name) => [name, Number(inputs[name].value)]));
  const numbers = (column, at) => {
    for (const [name, value] of Object.entries(table.numbers[place(at)])) {
      const cell = root.querySelector(`[data-number=${name}] .${column}`);
      cell.textContent = value === null ? "not yet" : told(value, 4);
    }
  };
  const show = () => {
    const at = chosen();
    for (const name of names) {
      const text = `${told(table.grid[name][at[name]])} ${inputs[name].dataset.unit}`;
      root.querySelector(`output[for=explorer-${name}]`).textContent = text;
      inputs[name].setAttribute("aria-valuetext", text);
    }
    plots.forEach((plot) => plot(at));
    numbers("chosen-number", at);
  };
  const choose = (at) => {
    for (const name of names) inputs[name].value = at[name] ?? table.published[name];
    show();
  };
  // The case is a part of the address, to be kept or sent: #T_p=0.1&K_2=870&set_velocity=5
  const fromAddress = () => {
    const asked = new URLSearchParams(location.hash.slice(1));
    const at = {};
    for (const name of names) {
      const n = table.grid[name].indexOf(Number(asked.get(name)));
      if (n >= 0) at[name] = n;
    }
    choose(at);
  };
  for (const name of names) {
    inputs[name].max = table.grid[name].length - 1;
    inputs[name].addEventListener("input", show);
    inputs[name].addEventListener("change", () => {
      const at = chosen();
      history.replaceState(null, "", "#" + names.map((key) => `${key}=${table.grid[key][at[key]]}`).join("&"));
    });
  }
  root.querySelector("button").addEventListener("click", () => {
    choose({});
    history.replaceState(null, "", location.pathname + location.search);
  });
  window.addEventListener("hashchange", fromAddress);
  numbers("published-number", table.published);
  fromAddress();
  root.hidden = false;
})();
