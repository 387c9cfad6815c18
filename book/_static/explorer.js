// The page Explorer: draws the case that the sliders choose, from the table that the page carries.
"use strict";
(() => {
  const root = document.querySelector(".explorer");
  if (!root) return; // every page loads this, the book as one page as well
  const table = JSON.parse(document.getElementById("explorer-data").textContent);
  const names = Object.keys(table.grid);
  const runs = window.armRuns(table);
  const place = (at) => names.reduce((n, name) => n * table.grid[name].length + at[name], 0);

  const H = 168, LEFT = 52, TOP = 24, BOTTOM = 22, LAST = 20;
  const TITLES = ["velocity / (m/s)", "motor current / A", "gear force / N"];
  const made = window.armDraw;
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

  const shown = root.querySelector("select");
  const box = root.querySelector(".plots");
  const plots = TITLES.map((title, k) => {
    const height = H + (k === 2 ? LAST : 0);
    const svg = made("svg", { height, role: "img", "aria-label": `${title} against time; the numbers are in the table` }, box);
    const axes = made("g", {}, svg);
    const old = made("path", { class: "curve published" }, svg);
    const now = made("path", { class: "curve chosen", "data-curve": table.curves[k] }, svg);
    made("text", { x: 0, y: 14 }, svg, title);
    const name = k === 2 ? made("text", { y: H + LAST - 6, "text-anchor": "middle" }, svg, "time / s") : null;
    return (cases) => {
      const W = box.clientWidth || 600; // a unit is a pixel, so that labels keep their size
      svg.setAttribute("viewBox", `0 0 ${W} ${height}`);
      name?.setAttribute("x", (LEFT + W) / 2);
      const end = Number(shown.value);
      const both = cases.map((one) => one.curves[table.curves[k]]).map(([times, values]) => {
        const last = times.findIndex((t) => t > end); // the first corner beyond the window
        const [a, b] = [times[last - 1], times[last]];
        if (last < 0) return times.map((t, n) => [t, values[n]]);
        const v = values[last - 1] + ((values[last] - values[last - 1]) * (end - a)) / (b - a);
        return [...times.slice(0, last).map((t, n) => [t, values[n]]), [end, v]];
      });
      const reached = both.flat().map((point) => point[1]);
      const [low, high] = [Math.min(0, ...reached), Math.max(...reached)];
      const x = (t) => LEFT + ((W - LEFT - 8) * t) / end;
      const y = (v) => TOP + ((H - TOP - BOTTOM) * (high - v)) / (high - low);
      const path = (line) => "M" + line.map(([t, v]) => `${x(t).toFixed(1)},${y(v).toFixed(1)}`).join("L");
      axes.replaceChildren();
      for (const v of ticks(low, high)) {
        made("line", { class: "grid", x1: LEFT, x2: W - 8, y1: y(v), y2: y(v) }, axes);
        made("text", { x: LEFT - 6, y: y(v) + 4, "text-anchor": "end" }, axes, told(v));
      }
      for (const t of ticks(0, end, 6)) {
        made("text", { x: x(t), y: H - 4, "text-anchor": "middle" }, axes, told(t));
      }
      old.setAttribute("d", path(both[0]));
      now.setAttribute("d", path(both[1]));
    };
  });

  const inputs = Object.fromEntries(names.map((name) => [name, root.querySelector(`input[name=${name}]`)]));
  const chosen = () => Object.fromEntries(names.map((name) => [name, Number(inputs[name].value)]));
  const motion = window.armMotion(document.querySelector(".arm-motion:not([data-table])"), table);
  const numbers = (column, at) => {
    for (const [name, value] of Object.entries(table.numbers[place(at)])) {
      const cell = root.querySelector(`[data-number=${name}] .${column}`);
      cell.textContent = value === null ? "–" : told(value, 4);
    }
  };
  const show = () => {
    const at = chosen();
    for (const name of names) {
      const text = `${told(table.grid[name][at[name]])} ${inputs[name].dataset.unit}`;
      root.querySelector(`output[for=explorer-${name}]`).textContent = text;
      inputs[name].setAttribute("aria-valuetext", text);
    }
    const run = runs(place(at));
    draw();
    motion(run, table.grid.set_velocity[at.set_velocity] / 10);
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
  const draw = () => plots.forEach((plot) => plot([table.published, chosen()].map((at) => runs(place(at)))));
  shown.addEventListener("change", draw);
  window.addEventListener("resize", draw);
  root.querySelector("button").addEventListener("click", () => {
    choose({});
    history.replaceState(null, "", location.pathname + location.search);
  });
  window.addEventListener("hashchange", fromAddress);
  root.hidden = false;
  numbers("published-number", table.published);
  fromAddress();
})();
