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
    const svg = make("svg", { viewBox: "0 0 700 470", role: "img", "aria-label": title });
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
    plane.dots(at(data.refused, i), at(data.refused, j), "muted", 1.5);
    // Of candidates one behind the other the best is shown.
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
    svg.addEventListener("pointermove", (event) => {
      const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const nearest = (list) => {
        const away = list.map((one) => Math.hypot(plane.across(one[i]) - x, plane.up(one[j]) - y));
        const k = away.indexOf(Math.min(...away));
        return [away[k] ?? Infinity, k];
      };
      const where = (one) => data.names.map((name, k) => `${name.replace(/ \[.*/, "")} ${words(one[k])}`).join(", ");
      const [[d0, k0], [d1, k1], [d2, k2]] = [data.plan, order.map((q) => candidates[q]).reverse(), data.refused].map(nearest);
      if (d0 < 9) readout.textContent = `Position ${k0 + 1}, ${data.visits[k0]}: ${where(data.plan[k0])}`;
      else if (d2 < d1) readout.textContent = `Rejected (${data.reasons[data.reason[k2]]}): ${where(data.refused[k2])}`;
      else {
        const q = order[order.length - 1 - k1];
        readout.textContent = `Candidate, sensitivity ${sensitivity[q].toFixed(2)}: ${where(candidates[q])}`;
      }
    });
    holder.replaceChildren(svg);
  };
  draw();
})();
