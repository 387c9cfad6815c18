// Runs of the arm, unpacked from a table, and set in motion: the arm on its rail, the gear tooth in
// its play, the signals with their limits, and the events. A page without this script shows a figure.
"use strict";

// A function from the number of a case to its curves, events and numbers; see armbook.explorer.
window.armRuns = (table) => {
  const bytes = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer;
  const [counts, eventCounts, codes] = ["counts", "event_counts", "event_codes"].map((key) => new Uint16Array(bytes(table[key])));
  const packed = bytes(table.points);
  const [times, values] = [new Uint16Array(packed), new Int16Array(packed)];
  const moments = new Float64Array(bytes(table.event_times));
  const sums = (numbers, factor) => {
    let sum = 0;
    return [0, ...Array.from(numbers, (n) => (sum += factor * n))];
  };
  const [starts, eventStarts] = [sums(counts, 2), sums(eventCounts, 1)];
  return (n) => {
    const curves = table.curves.map((name, k) => {
      const m = n * table.curves.length + k, [from, count] = [starts[m], counts[m]];
      const t = Array.from(times.subarray(from, from + count), (tick) => tick * table.tick);
      const v = Array.from(values.subarray(from + count, from + 2 * count), (whole) => whole * table.scale[k]);
      return [name, [t, v]];
    });
    const events = Array.from({ length: eventCounts[n] }, (_, k) => {
      const code = codes[eventStarts[n] + k];
      const [preamplifier, motor_voltage, contact] = [9, 3, 1].map((unit) => (Math.floor(code / unit) % 3) - 1);
      return { time: moments[eventStarts[n] + k], words: table.words[Math.floor(code / 27)], preamplifier, motor_voltage, contact };
    });
    return { curves: Object.fromEntries(curves), events, numbers: table.numbers[n] };
  };
};

window.armDraw = (name, attributes, parent, text = "") => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  Object.entries(attributes).forEach(([key, value]) => node.setAttribute(key, value));
  node.textContent = text;
  return parent.appendChild(node);
};

// Change the text of an element, which stays the same node: while nodes come and go, the theme
// waits with making what scrolls reachable by the keyboard.
window.armWrite = (element, text) => {
  if (!element.firstChild) element.append("");
  element.firstChild.data = text;
};

// Fill an element with the animation; return a function that shows a run.
window.armMotion = (root, table) => {
  const draw = window.armDraw, write = window.armWrite;
  const W = 340, LEFT = 8, RIGHT = 332;
  const told = (value, digits) => {
    const text = value.toFixed(digits);
    return (Number(text) === 0 ? text.replace("-", "") : text).replace("-", "−");
  };
  root.innerHTML = `
    <div class="panels">${["rail", "gear", "signals", "speed"].map((name) => `<svg class="${name}" aria-hidden="true"></svg>`).join("")}</div>
    <div class="controls"><button type="button">Play</button>
      <input type="range" min="0" max="${table.t_end}" step="${table.t_end / 1000}" aria-label="time"><span class="clock"></span>
      <label>pace <select><option value="events">slow at the events</option><option value="0.25">a quarter of real time</option><option value="1">real time</option></select></label></div>
    <div class="events"><ol aria-label="events"></ol></div>`;
  const panel = (name, height) => {
    const svg = root.querySelector(`svg.${name}`);
    svg.setAttribute("viewBox", `0 0 ${W} ${height}`);
    return svg;
  };
  const heading = (svg, text) => draw("text", { x: LEFT, y: 14 }, svg, text);
  const reading = (svg, y = 14) => draw("text", { x: RIGHT, y, "text-anchor": "end" }, svg);
  let run, now = 0, playing = false, last = 0;

  // Value of a curve between its corners, and the area below it up to there.
  const at = (name, t) => {
    const [times, values] = run.curves[name];
    let low = 0, high = times.length - 1;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (times[middle] <= t) low = middle; else high = middle;
    }
    const share = Math.min(Math.max((t - times[low]) / (times[high] - times[low]), 0), 1);
    return [values[low] + share * (values[high] - values[low]), low];
  };
  const position = (t) => {
    const [velocity, n] = at("velocity", t);
    return run.positions[n] + ((t - run.curves.velocity[0][n]) * (run.curves.velocity[1][n] + velocity)) / 2;
  };
  // What holds after the newest event.
  const state = () => run.events.filter((event) => event.time <= now).pop() ?? { preamplifier: 0, motor_voltage: 0, contact: 0 };

  // The rack moves with the arm, and the pinion rolls on it: teeth 14 apart, 8 on the pinion.
  const rail = panel("rail", 104), RADIUS = (8 * 14) / (2 * Math.PI), GAP = 122, TRAVEL = 104;
  heading(rail, "arm and motor");
  const where = reading(rail);
  draw("line", { class: "axis", x1: LEFT, x2: RIGHT, y1: 74, y2: 74 }, rail);
  const rack = draw("g", {}, rail);
  draw("path", { class: "arm-part", d: `M0,64v10h210v-10${"l-3,-7h-4l-3,7h-4".repeat(15)}z` }, rack);
  draw("rect", { class: "arm-part", x: 178, y: 74, width: 32, height: 24, rx: 2 }, rack);
  const pinion = draw("g", {}, rail);
  draw("circle", { class: "motor-part", r: RADIUS - 3 }, pinion);
  for (let n = 0; n < 8; n += 1) draw("path", { class: "motor-part", d: "M-4,-14h8l-2,-7h-4z", transform: `rotate(${45 * n})` }, pinion);
  draw("circle", { class: "mark", cy: -8, r: 3 }, pinion);
  const showRail = () => {
    const s = position(now), shift = (TRAVEL * s) / Math.max(run.positions.at(-1), 1e-9);
    rack.setAttribute("transform", `translate(${LEFT + shift},0)`);
    pinion.setAttribute("transform", `translate(${GAP},${61 - RADIUS}) rotate(${180 - (shift / RADIUS) * (180 / Math.PI)})`);
    write(where, `${told(s, 3)} m`);
  };

  // One tooth of the pinion between flanks of the rack; in contact, the flank gives way.
  const gear = panel("gear", 118), EDGE = 40;
  let x;
  heading(gear, "gear tooth, magnified");
  const touch = reading(gear);
  const flanks = [0, 1].map(() => draw("path", { class: "flank arm-part" }, gear));
  const tooth = draw("path", { class: "motor-part", d: "M-26,28l10,44h32l10,-44z" }, gear);
  const scale = draw("g", {}, gear);
  const scaleGear = () => {
    const apart = run.curves.difference[1];
    const [low, high] = [Math.min(-40, ...apart), Math.max(160, ...apart)];
    x = (micrometres) => EDGE + ((W - 2 * EDGE) * (micrometres - low)) / (high - low);
    scale.replaceChildren();
    draw("path", { class: "axis", d: `M${x(low)},98H${x(high)}M${x(0)},94v8M${x(100)},94v8` }, scale);
    draw("text", { class: "small", x: x(0), y: 114, "text-anchor": "middle" }, scale, "0");
    draw("text", { class: "small", x: x(100), y: 114, "text-anchor": "middle" }, scale, "100 µm");
  };
  const contact = () => (state().contact ? `force ${told(at("gear_force", now)[0], 0)} N` : "no contact");
  const showGear = () => {
    const apart = at("difference", now)[0], side = state().contact;
    const left = x(side < 0 ? apart : -table.play), right = x(side > 0 ? apart : table.play);
    flanks[0].setAttribute("d", `M0,34H${left - 24.6}L${left - 13.3},84H0z`); // as steep as the tooth
    flanks[1].setAttribute("d", `M${W},34H${right + 24.6}L${right + 13.3},84H${W}z`);
    flanks.forEach((flank, n) => flank.classList.toggle("pressed", side === 2 * n - 1));
    tooth.setAttribute("transform", `translate(${x(apart)},0)`);
    write(touch, contact());
  };

  const signals = panel("signals", 118), MIDDLE = 170, LIMIT = 130;
  const bars = [["motor_voltage", "motor voltage", "V", 1], ["preamplifier", "preamplifier, which sets the current", "V", 2], ["current", "motor current", "A", 2]].map(([name, title, unit, digits], n) => {
    const y = 20 + 38 * n;
    draw("text", { x: LEFT, y: y - 6 }, signals, title);
    const value = reading(signals, y - 6);
    draw("rect", { class: "track", x: LEFT, y, width: RIGHT - LEFT, height: 10, rx: 2 }, signals);
    const bar = draw("rect", { y, height: 10 }, signals);
    for (const edge of [MIDDLE - LIMIT, MIDDLE, MIDDLE + LIMIT]) draw("line", { class: edge === MIDDLE ? "axis" : "limit", x1: edge, x2: edge, y1: y - 2, y2: y + 12 }, signals);
    return () => {
      const side = state()[name], v = side ? side * table.limits[name] : at(name, now)[0];
      const length = Math.min((LIMIT * Math.abs(v)) / table.limits[name], 162);
      bar.setAttribute("x", v < 0 ? MIDDLE - length : MIDDLE);
      bar.setAttribute("width", length);
      bar.setAttribute("class", side ? "bar at-limit" : "bar");
      write(value, `${side ? "at its limit, " : ""}${told(v, digits)} ${unit}`);
    };
  });

  const speed = panel("speed", 118), sx = (t) => 30 + (302 * t) / table.t_end;
  heading(speed, "velocity of the arm, and events");
  const velocity = reading(speed);
  const plot = draw("g", {}, speed);
  const cursor = draw("line", { class: "cursor", y1: 22, y2: 112 }, speed);
  const plotSpeed = () => {
    const [times, speeds] = run.curves.velocity;
    const top = Math.max(...speeds), sy = (v) => 102 - (78 * v) / top;
    plot.replaceChildren();
    for (const v of [0, run.goal]) {
      draw("line", { class: "grid", x1: 30, x2: RIGHT, y1: sy(v), y2: sy(v) }, plot);
      draw("text", { class: "small", x: 26, y: sy(v) + 4, "text-anchor": "end" }, plot, String(v));
    }
    for (const { time } of run.events) draw("line", { class: "event", x1: sx(time), x2: sx(time), y1: 103, y2: 112 }, plot);
    draw("path", { class: "curve", d: "M" + times.map((t, n) => `${sx(t).toFixed(1)},${sy(speeds[n]).toFixed(1)}`).join("L") }, plot);
  };

  const [slider, button, pace, list, clock] = ["input", "button", "select", "ol", ".clock"].map((name) => root.querySelector(name));
  const show = () => {
    showRail(), showGear(), bars.forEach((bar) => bar());
    write(velocity, `${told(at("velocity", now)[0], 3)} m/s`);
    cursor.setAttribute("x1", sx(now)), cursor.setAttribute("x2", sx(now));
    const past = run.events.filter((event) => event.time <= now).length;
    [...list.children].forEach((item, n) => {
      item.classList.toggle("past", n < past);
      item.toggleAttribute("aria-current", n === past - 1);
    });
    const box = list.parentElement; // the list scrolls, never the page
    box.scrollTop = past ? list.children[past - 1].offsetTop - box.clientHeight / 2 : 0;
    write(clock, `${told(1e3 * now, now < 0.01 ? 3 : 1)} ms`);
    slider.value = now;
    slider.setAttribute("aria-valuetext", `${clock.textContent}: arm at ${where.textContent}, ${velocity.textContent}, gear ${contact()}`);
  };

  // Events that are close together are shown in slow motion, the more of them the longer.
  const slowed = (events) => {
    const groups = [];
    for (const { time } of events) {
      const group = groups.at(-1);
      if (group && time - group.to < 0.03) group.to = time, group.seconds += 0.9;
      else groups.push({ from: time, to: time, seconds: 1.7 });
    }
    return groups.map(({ from, to, seconds }) => {
      const around = 0.0005 + 0.2 * (to - from);
      return { from: from - around, to: to + around, rate: (to - from + 2 * around) / Math.min(seconds, 8) };
    });
  };
  const rate = () => {
    if (pace.value !== "events") return Number(pace.value);
    return (run.slow.find(({ from, to }) => now >= from && now < to) ?? { rate: table.t_end / 4 }).rate;
  };
  const step = (time) => {
    if (!playing) return;
    now += (rate() * Math.min(Math.max(time - last, 0), 100)) / 1e3;
    last = time;
    if (now >= table.t_end) { now = table.t_end; play(false); }
    show();
    if (playing) requestAnimationFrame(step);
  };
  const play = (wanted) => {
    playing = wanted;
    write(button, playing ? "Pause" : "Play");
    if (!playing) return;
    if (now >= table.t_end) now = 0;
    last = performance.now();
    requestAnimationFrame(step);
  };
  const jump = (time) => { play(false); now = time; show(); };
  button.addEventListener("click", () => play(!playing));
  slider.addEventListener("input", () => jump(Number(slider.value)));
  root.hidden = false;
  root.classList.add("ready");

  const take = (chosen, goal) => {
    const [times, speeds] = chosen.curves.velocity;
    let sum = 0;
    const positions = times.map((t, n) => (sum += n ? ((t - times[n - 1]) * (speeds[n] + speeds[n - 1])) / 2 : 0));
    run = { ...chosen, goal, positions, slow: slowed(chosen.events) };
    plotSpeed();
    scaleGear();
    list.replaceChildren(...run.events.map((event) => {
      const item = document.createElement("li"), choose = item.appendChild(document.createElement("button"));
      choose.type = "button";
      choose.textContent = `${told(1e3 * event.time, event.time < 0.01 ? 4 : 1)} ms: ${event.words}`;
      choose.addEventListener("click", () => jump(event.time));
      return item;
    }));
    list.classList.toggle("long", run.events.length > 20);
    // It stands still where the tooth is crossing its play.
    const n = run.events.findIndex((event) => event.time > 0.02 && event.contact === 0);
    jump(n < 0 ? 0 : (run.events[n].time + (run.events[n + 1]?.time ?? table.t_end)) / 2);
  };
  // It begins by itself when it comes into sight, if the reader has nothing against motion.
  take.begin = () => {
    if (matchMedia("(prefers-reduced-motion: reduce)").matches) return;
    const seen = new IntersectionObserver((entries) => {
      if (!entries.some((entry) => entry.isIntersecting)) return;
      seen.disconnect();
      now = 0;
      play(true);
    }, { threshold: 0.5 });
    seen.observe(root);
  };
  return take;
};

(() => {
  const root = document.querySelector(".arm-motion[data-table]");
  if (!root) return; // the explorer shows the case that its sliders choose
  const table = JSON.parse(document.getElementById(root.dataset.table).textContent);
  const take = window.armMotion(root, table);
  take(window.armRuns(table)(0), 0.1 * table.grid.set_velocity[0]);
  take.begin();
})();
