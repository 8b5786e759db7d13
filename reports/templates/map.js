// Candidates of a design over two coordinates that can be chosen. No network.
(async () => {
  "use strict";
  const store = document.querySelector("script.candidates");
  const figure = store && document.getElementById("design-map");
  if (!figure || !("DecompressionStream" in window)) return;
  const data = JSON.parse(store.textContent);
  const { words, make, ticks, extent, axes } = plotting("design-map");
  const c = data.names.length;
  const flat = await unpacked(data.candidates, c);
  const sensitivity = await unpacked(data.sensitivity, 1);
  const candidates = Array.from(sensitivity, (_, q) => flat.subarray(q * c, (q + 1) * c));
  const order = [...candidates.keys()].sort((a, b) => sensitivity[a] - sensitivity[b]);
  const [low, high] = [sensitivity[order[0]], sensitivity[order[order.length - 1]]];

  const holder = figure.querySelector(".scroll");
  const readout = figure.querySelector("output");
  const bar = document.createElement("div");
  bar.className = "chooser";
  const choice = (label, value) => {
    const box = document.createElement("select");
    box.setAttribute("aria-label", label);
    data.names.forEach((name, k) => box.append(new Option(name, k)));
    box.value = value;
    const words_ = document.createElement("label");
    words_.append(`${label} `, box);
    bar.append(words_);
    box.addEventListener("change", () => draw());
    return box;
  };
  const [xBox, yBox] = [choice("across", figure.dataset.across), choice("up", figure.dataset.up)];
  figure.prepend(bar);

  const draw = () => {
    const [i, j] = [Number(xBox.value), Number(yBox.value)];
    const everything = [...candidates, ...data.plan, ...data.refused];
    const [xr, yr] = [i, j].map((k) => extent([everything.map((one) => one[k])], 0.06));
    const title = `Candidates over ${data.names[i]} and ${data.names[j]}`;
    const svg = make("svg", { viewBox: "0 0 700 492", role: "img", tabindex: 0, "aria-label": title });
    svg.style.setProperty("--width", 520);
    const plane = axes(svg, [62, 10, 620, 410], xr, yr,
      { log: false, xs: ticks(...xr), ys: ticks(...yr), title: data.names[j], xTitle: data.names[i], name: "a" });
    const [a, b] = [i, j].map((k) => k - (c - 3)); // axes of space
    if (a >= 0 && b >= 0)
      for (const [, lowest, highest] of data.obstacles) {
        const [x, y] = [[lowest[a], highest[a]], [lowest[b], highest[b]]];
        plane.band(x, [y[0], y[0]], [y[1], y[1]], "muted");
      }
    const at = (list, k) => list.map((one) => one[k]);
    plane.dots(at(data.refused, i), at(data.refused, j), "muted", 3.5, 0.7);
    // Of candidates that coincide in this projection the best is shown.
    const spot = (one) => `${Math.round(plane.across(one[i]))} ${Math.round(plane.up(one[j]))}`;
    const best = [...new Map(order.map((q) => [spot(candidates[q]), q])).values()];
    for (let shade = 0; shade < 8; shade++) {
      const part = best.filter((q) => Math.min(Math.floor((8 * (sensitivity[q] - low)) / (high - low || 1)), 7) === shade);
      const shown = part.map((q) => candidates[q]);
      plane.dots(at(shown, i), at(shown, j), "accent", 4, 0.06 + 0.12 * shade);
    }
    const numbers = new Map();
    data.plan.forEach((one, k) => numbers.set(spot(one), [...(numbers.get(spot(one)) ?? []), k]));
    for (const several of numbers.values()) {
      const one = data.plan[several[0]];
      plane.dots([one[i]], [one[j]], "second", 5);
      const place = { x: plane.across(one[i]) + 7, y: plane.up(one[j]) - 5 };
      svg.append(make("text", { ...place, "font-size": 11, fill: "var(--ink)" }, several.map((k) => k + 1).join(", ")));
    }
    // What the shades say.
    const key = { y: 484, "font-size": 11, fill: "var(--muted)" };
    svg.append(make("text", { ...key, x: 194, "text-anchor": "end" }, `sensitivity ${low.toFixed(2)}`));
    for (let shade = 0; shade < 8; shade++) {
      const place = { x: 200 + 16 * shade, y: 475, width: 16, height: 10 };
      svg.append(make("rect", { ...place, fill: "var(--accent)", opacity: 0.06 + 0.12 * shade }));
    }
    svg.append(make("text", { ...key, x: 334 }, high.toFixed(2)));
    const ring = make("circle", { r: 7, fill: "none", stroke: "var(--ink)", "stroke-width": 1.4, visibility: "hidden" });
    svg.append(ring);

    // Positions of the plan, then candidates, the best first, then those that were rejected.
    const [P, C] = [data.plan.length, order.length];
    const every = [...data.plan, ...order.map((q) => candidates[q]).reverse(), ...data.refused];
    const parted = data.names.map((name) => /^(.*?)(?: \[(.*)\])?$/.exec(name));
    const unit = (word) => (word === "°" ? word : word ? ` ${word}` : "");
    const where = (one) => parted.map(([, name, u], k) => `${name} ${words(one[k])}${unit(u)}`).join(", ");
    const told = (k) => {
      const q = order[C - 1 - (k - P)];
      if (k < P) return `Position ${k + 1}, ${data.visits[k]}`;
      if (k >= P + C) return `Rejected (${data.reasons[data.reason[k - P - C]]})`;
      return `Candidate, sensitivity ${sensitivity[q].toFixed(2)}, weight ${words(data.weights[q] ?? 0)}`;
    };
    let now = -1;
    const point = (k) => {
      now = k;
      const one = every[k];
      for (const [name, value] of Object.entries({ cx: plane.across(one[i]), cy: plane.up(one[j]), visibility: "visible" }))
        ring.setAttribute(name, value);
      readout.textContent = `${told(k)}: ${where(one)}`;
    };
    svg.addEventListener("pointermove", (event) => {
      const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const away = every.map((one) => Math.hypot(plane.across(one[i]) - x, plane.up(one[j]) - y));
      const nearest = (from, to) => {
        let best = from;
        for (let k = from; k < to; k++) if (away[k] < away[best]) best = k;
        return best;
      };
      const [a, b, c] = [nearest(0, P), nearest(P, P + C), nearest(P + C, every.length)];
      if (away[a] < 9) point(a);
      else point(away[c] < away[b] ? c : b);
    });
    svg.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 }[event.key];
      if (!step) return;
      point(now < 0 ? (step > 0 ? 0 : every.length - 1) : (now + step + every.length) % every.length);
      event.preventDefault();
    });
    holder.replaceChildren(svg);
  };
  draw();
})();
