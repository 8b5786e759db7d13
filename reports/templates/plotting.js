// Axes and curves that scripts of a page draw as SVG.
const plotting = (prefix) => {
  "use strict";
  const words = (value, digits = 3) => Number(value.toPrecision(digits)).toString().replace("-", "−");
  const make = (tag, attributes = {}, text = "") => {
    const one = document.createElementNS("http://www.w3.org/2000/svg", tag);
    for (const [name, value] of Object.entries(attributes)) one.setAttribute(name, value);
    one.textContent = text;
    return one;
  };
  const ticks = (low, high, most = 6) => {
    const rough = (high - low) / most;
    const decade = 10 ** Math.floor(Math.log10(rough));
    const step = [1, 2, 2.5, 5, 10].map((v) => v * decade).find((v) => v >= rough);
    const first = Math.ceil(low / step - 1e-9);
    return Array.from({ length: Math.floor(high / step + 1e-9) - first + 1 }, (_, k) => (first + k) * step);
  };
  const decades = (low, high) => {
    const within = [];
    for (let e = Math.floor(Math.log10(low)); e <= Math.log10(high); e++)
      for (const d of [1, 2, 5]) within.push(d * 10 ** e);
    return within.filter((v) => v >= low * 0.999 && v <= high * 1.001);
  };
  const extent = (arrays, margin = 0.05) => {
    const finite = arrays.flatMap((a) => [...a]).filter(Number.isFinite);
    const [low, high] = [Math.min(...finite), Math.max(...finite)];
    const more = margin * (high - low || 1);
    return [low - more, high + more];
  };
  // Axes in a box [left, top, width, height] of the drawing; draws curves of its own coordinates.
  const axes = (svg, box, [x0, x1], [y0, y1], { log = true, xs, ys, title, xTitle, name }) => {
    const [left, top, width, height] = box;
    const along = log ? Math.log : (v) => v;
    const across = (x) => left + (width * (along(x) - along(x0))) / (along(x1) - along(x0));
    const up = (y) => top + (height * (y1 - y)) / (y1 - y0);
    const grid = (xs ?? decades(x0, x1)).map((x) => `M${across(x)} ${top}v${height}`);
    const rules = ys.map((y) => `M${left} ${up(y)}h${width}`);
    const frame = `M${left} ${top}v${height}h${width}`;
    svg.append(make("path", { d: [...grid, ...rules].join(""), stroke: "var(--rule)", "stroke-width": 0.6 }));
    svg.append(make("path", { d: frame, fill: "none", stroke: "var(--muted)", "stroke-width": 0.8 }));
    const small = { "font-size": 11, fill: "var(--muted)" };
    for (const y of ys)
      svg.append(make("text", { ...small, x: left - 6, y: up(y) + 4, "text-anchor": "end" }, words(y)));
    if (xTitle) {
      const middle = { ...small, "text-anchor": "middle" };
      for (const x of xs ?? decades(x0, x1))
        svg.append(make("text", { ...middle, x: across(x), y: top + height + 15 }, words(x)));
      svg.append(make("text", { ...middle, x: left + width / 2, y: top + height + 33 }, xTitle));
    }
    const turned = `translate(${left - 46} ${top + height / 2}) rotate(-90)`;
    svg.append(make("text", { ...small, transform: turned, "text-anchor": "middle" }, title));
    const id = `${prefix}-${name}`;
    const clip = make("clipPath", { id });
    clip.append(make("rect", { x: left, y: top, width, height }));
    const curves = make("g", { "clip-path": "url" + `(#${id})`, fill: "none", "stroke-linejoin": "round" });
    svg.append(clip, curves);
    const points = (x, y) => y.map((v, k) => [across(x[k]), up(v)]);
    const path = (list, jumps) =>
      list.map(([px, py], k) => {
        const jump = !k || (jumps && Math.abs(py - list[k - 1][1]) > height / 2);
        return `${jump ? "M" : "L"}${px.toFixed(1)} ${py.toFixed(1)}`;
      }).join("");
    return {
      across, up, box,
      line: (x, y, colour, pen, jumps = false, dashes = "") => {
        const style = { stroke: `var(--${colour})`, "stroke-width": pen, "stroke-dasharray": dashes || "none" };
        curves.append(make("path", { d: path(points(x, y), jumps), ...style }));
      },
      dots: (x, y, colour, radius = 2, opacity = 1) => {
        const d = points(x, y).map(([px, py]) => `M${px.toFixed(1)} ${py.toFixed(1)}h0`).join("");
        const pen = { stroke: `var(--${colour})`, "stroke-width": 2 * radius, "stroke-linecap": "round", opacity };
        curves.append(make("path", { d, ...pen }));
      },
      band: (x, low, high, colour) => {
        const ends = [...points(x, high), ...points(x, low).reverse()];
        curves.append(make("path", { d: `${path(ends)}Z`, fill: `var(--${colour})`, opacity: 0.28 }));
      },
    };
  };

  return { words, make, ticks, extent, axes };
};
