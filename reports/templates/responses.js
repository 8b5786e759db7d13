// Frequency responses: one element enlarged, with values under the pointer. No network.
(async () => {
  "use strict";
  const store = document.querySelector("script.responses");
  const figure = store && document.getElementById("frf-element");
  if (!figure || !("DecompressionStream" in window)) return;
  const data = JSON.parse(store.textContent);
  // Of what the curves are: FRFs and a model's, of spectra and predictions, or FRFs of two studies.
  const { noun, column, names, paired } = data.element;
  const [Q, m, n, F] = [data.ids, data.outputs, data.inputs, data.frequency].map((a) => a.length);
  const fine = data.fine ?? data.frequency;
  const between = (fine.length - 1) / Math.max(F - 1, 1); // points from line to line

  const complex = async (parts, length) =>
    parts && (await Promise.all(parts.map((part) => unpacked(part, length))));
  const measured = await complex(data.measured, F);
  const model = await complex(data.model, fine.length);
  const std = await unpacked(data.std, F);
  const modelStd = data.modelStd && (await unpacked(data.modelStd, F));
  const predictive = await complex(data.predictive, F);
  const singular = await unpacked(data.singular, F);
  const modelSingular = data.modelSingular && (await unpacked(data.modelSingular, fine.length));

  // Values of one element in one position: ln |G| and phase at each frequency.
  const cut = (array, index, length) => array.subarray(index * length, (index + 1) * length);
  const element = (q, i, j) => {
    const index = (q * m + i) * n + j;
    return {
      size: cut(measured[0], index, F),
      phase: cut(measured[1], index, F),
      std: cut(std, index, F),
      modelSize: model && cut(model[0], index, fine.length),
      modelPhase: model && cut(model[1], index, fine.length),
      modelStd: modelStd && cut(modelStd, index, F),
      predictive: predictive && predictive.map((end) => cut(end, index, F)),
    };
  };
  const { words, make, ticks, extent, axes } = plotting("frf-element");
  let width = 780; // of axes; narrow screens have narrow ones, with the same words
  const DECIBELS = 20 / Math.LN10;
  const decibels = (logarithms) => [...logarithms].map((value) => DECIBELS * value);
  const degrees = (phases) => [...phases].map((v) => ((((v * 180) / Math.PI + 180) % 360) + 360) % 360 - 180);

  // What is shown.
  const state = { q: 0, i: 0, j: 0, view: 0, beside: 0, band: 0 };
  const bar = figure.querySelector(".chooser");
  const select = (label, options, name) => {
    const holder = document.createElement("label");
    const box = document.createElement("select");
    box.setAttribute("aria-label", label);
    holder.append(`${label} `, box);
    options.forEach((text, value) => box.append(new Option(text, value)));
    box.addEventListener("change", () => ((state[name] = Number(box.value)), draw()));
    bar.append(holder);
    return box;
  };
  const VIEWS = [paired ? "Bode and difference" : "Bode and residuals", "Nyquist", "singular values", "coherence from SNR"];
  const toBox = select(column === "of" ? "output" : "to", data.outputs, "i");
  const fromBox = select(column, data.inputs, "j");
  select("as", VIEWS.slice(0, data.element.views), "view");
  const SINGULAR = 2; // of the whole matrix, not of an element
  const positions = data.ids.map((_, q) => `${noun} ${q + 1}`);
  const besideBox = Q > 1 && !paired && select("beside", ["no other", `all ${noun}s`, ...positions], "beside");
  const BANDS = ["model, one standard deviation", "posterior predictive, 95 %"];
  const bandBox = predictive && select("band", BANDS, "band");

  const holder = figure.querySelector(".scroll");
  const readout = figure.querySelector("output");
  const besides = () =>
    [...data.ids.keys()].filter((q) => q !== state.q && (state.beside === 1 || state.beside === q + 2));
  const ends = (array) => [array[0], array[array.length - 1]];
  const f = data.frequency;
  const line = (k) => Math.round(k * between); // of the model
  const atFine = (values) =>
    fine.map((_, k) => {
      const a = Math.min(Math.floor(k / between), F - 1), t = k / between - a;
      return values[a] * (1 - t) + values[Math.min(a + 1, F - 1)] * t;
    });
  // Cubic between neighbours (Catmull and Rom 1974), so that circles look round.
  const rounded = (values) =>
    [...values].flatMap((b, k) => {
      if (k === values.length - 1) return [b];
      const [a, c, d] = [k - 1, k + 1, k + 2].map((i) => values[Math.min(Math.max(i, 0), values.length - 1)]);
      return [0, 0.25, 0.5, 0.75].map(
        (t) => b + (t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))) / 2,
      );
    });
  const residual = (one, k) => {
    const [a, b] = [Math.exp(one.size[k] - one.std[k]), Math.exp(one.modelSize[line(k)] - one.std[k])];
    const [p, r] = [one.phase[k], one.modelPhase[line(k)]];
    return [a * Math.cos(p) - b * Math.cos(r), a * Math.sin(p) - b * Math.sin(r)].map((v) => Math.SQRT2 * v);
  };
  const apart = (one, k) => DECIBELS * (one.modelSize[line(k)] - one.size[k]);
  const frequencies = [...ends(f)];
  if (frequencies[0] === frequencies[1]) frequencies[1] *= 1.01;

  const bode = (svg, one) => {
    const size = decibels(one.size);
    const part = [...one.size].map((v, k) => Math.exp(one.std[k] - v));
    const low = size.map((v, k) => v + DECIBELS * Math.log(Math.max(1 - part[k], 1e-3)));
    const high = size.map((v, k) => v + DECIBELS * Math.log(1 + part[k]));
    const also = besides().map((q) => element(q, state.i, state.j));
    const shown = [size, high, ...also.map((other) => decibels(other.size))];
    if (model) shown.push(decibels(one.modelSize));
    const foreseen = state.band === 1 && one.predictive.map(decibels);
    if (foreseen) shown.push(foreseen[1]);
    const range = extent(shown);
    range[0] = Math.max(range[0], range[1] - 120);
    const unit = data.units[state.i];
    const upper = axes(svg, [62, 10, width, 230], frequencies, range, { ys: ticks(...range), title: `dB of 1 ${unit}`, name: "a" });
    const turns = [-180, -90, 0, 90, 180];
    const lower = axes(svg, [62, 256, width, 110], frequencies, [-180, 180],
      { ys: turns, title: "phase [°]", name: "b", xTitle: model ? "" : "frequency [Hz]" });
    upper.band(f, low, high, "accent");
    for (const other of also) {
      upper.line(f, decibels(other.size), "muted", 0.7);
      lower.line(f, degrees(other.phase), "muted", 0.7, true);
    }
    upper.line(f, size, "accent", 1.1);
    lower.line(f, degrees(one.phase), "accent", 1.1, true);
    if (!model) return [upper, lower];
    if (foreseen) upper.band(f, ...foreseen, "second");
    else if (one.modelStd) {
      const relative = atFine(one.modelStd).map((v) => Math.min(Math.exp(v), 0.999));
      const middle = decibels(one.modelSize);
      const ofModel = [-1, 1].map((s) => middle.map((v, k) => v + DECIBELS * Math.log(1 + s * relative[k])));
      upper.band(fine, ...ofModel, "second");
    }
    const dashes = paired ? "7 4" : "";
    upper.line(fine, decibels(one.modelSize), "second", 1.5, false, dashes);
    lower.line(fine, degrees(one.modelPhase), "second", 1.5, true, dashes);
    const below = [62, 382, width, 80];
    if (paired) {
      const away = f.map((_, k) => apart(one, k));
      const ends = extent([away, [0]]);
      const last = axes(svg, below, frequencies, ends,
        { ys: ticks(...ends, 4), title: "difference [dB]", name: "c", xTitle: "frequency [Hz]" });
      last.line(f, away, "ink", 1.1);
      return [upper, lower, last];
    }
    const left = f.map((_, k) => residual(one, k));
    const reach = Math.min(Math.max(4, ...left.flat().map(Math.abs)), 40);
    const last = axes(svg, below, frequencies, [-reach, reach],
      { ys: ticks(-reach, reach, 4), title: "residual [std]", name: "c", xTitle: "frequency [Hz]" });
    last.band(ends(f), [-2, -2], [2, 2], "muted");
    last.dots(f, left.map(([re]) => re), "accent");
    last.dots(f, left.map(([, im]) => im), "ink", 1.4);
    return [upper, lower, last];
  };
  const nyquist = (svg, one) => {
    const parts = (size, phase) => [Math.cos, Math.sin].map((part) => [...size].map((v, k) => Math.exp(v) * part(phase[k])));
    const curves = [parts(one.size, one.phase)];
    if (model) curves.push(parts(rounded(one.modelSize), rounded(one.modelPhase)));
    const also = besides().map((q) => element(q, state.i, state.j)).map((other) => parts(other.size, other.phase));
    const [[x0, x1], [y0, y1]] = [0, 1].map((side) => extent([[0], ...[...curves, ...also].map((c) => c[side])]));
    const scale = Math.max((x1 - x0) / width, (y1 - y0) / 440) / 2; // alike along both axes
    const [x, y] = [(x0 + x1) / 2, (y0 + y1) / 2];
    const [xr, yr] = [[x - width * scale, x + width * scale], [y - 440 * scale, y + 440 * scale]];
    const unit = data.units[state.i];
    const plane = axes(svg, [62, 10, width, 440], xr, yr,
      { log: false, xs: ticks(...xr), ys: ticks(...yr), title: `imaginary part [${unit}]`, xTitle: `real part [${unit}]`, name: "a" });
    for (const other of also) plane.line(...other, "muted", 0.7);
    plane.line(...curves[0], "accent", 0.6);
    plane.dots(...curves[0], "accent");
    if (model) plane.line(...curves[1], "second", 1.4, false, paired ? "7 4" : "");
    plane.points = curves[0][0].map((v, k) => [plane.across(v), plane.up(curves[0][1][k])]);
    return [plane];
  };
  const singularValues = (svg) => {
    const rank = Math.min(m, n);
    const shown = Array.from({ length: rank }, (_, k) => decibels(cut(singular, state.q * rank + k, F)));
    const ofModel = modelSingular
      ? shown.map((_, k) => decibels(cut(modelSingular, state.q * rank + k, fine.length))) : [];
    const range = extent([...shown, ...ofModel]);
    range[0] = Math.max(range[0], range[1] - 160);
    const plane = axes(svg, [62, 10, width, 440], frequencies, range,
      { ys: ticks(...range), title: "singular values [dB]", xTitle: "frequency [Hz]", name: "a" });
    for (const one of shown) plane.line(f, one, "accent", 1);
    for (const one of ofModel) plane.line(fine, one, "second", 1.4, false, paired ? "7 4" : "");
    return [plane];
  };
  // Bendat and Piersol (2010), (9.82): variance of an FRF from coherence and number of averages.
  const coherenceOf = (one, q) =>
    [...one.size].map((v, k) => 1 / (1 + data.repetitions[q] * Math.exp(2 * (one.std[k] - v))));
  const coherence = (svg, one) => {
    const plane = axes(svg, [62, 10, width, 440], frequencies, [0, 1.02],
      { ys: ticks(0, 1), title: "coherence of one experiment, from its SNR", xTitle: "frequency [Hz]", name: "a" });
    for (const q of besides()) plane.line(f, coherenceOf(element(q, state.i, state.j), q), "muted", 0.7);
    plane.line(f, coherenceOf(one, state.q), "accent", 1.4);
    return [plane];
  };
  const DRAWINGS = [bode, nyquist, singularValues, coherence];

  const told = (one, k) => {
    const share = (value) => `${words(100 * Math.exp(value), 2)} %`;
    const parts = [`${words(f[k], 4)} Hz`,
      `${names[state.q][0]} ${decibels([one.size[k]])[0].toFixed(1)} dB, ${degrees([one.phase[k]])[0].toFixed(0)}°, std ${share(one.std[k] - one.size[k])}`];
    if (model) {
      const g = line(k);
      const own = one.modelStd ? `, std ${share(one.modelStd[k])}` : "";
      parts.push(`${names[state.q][1]} ${decibels([one.modelSize[g]])[0].toFixed(1)} dB, ${degrees([one.modelPhase[g]])[0].toFixed(0)}°${own}`);
      if (state.band === 1) {
        const [low, high] = one.predictive.map((end) => decibels([end[k]])[0].toFixed(1));
        parts.push(`95 % of measurements between ${low} and ${high} dB`);
      }
      if (paired) parts.push(`difference ${apart(one, k).toFixed(2)} dB`);
      else parts.push(`residual ${residual(one, k).map((v) => v.toFixed(1)).join(" and ")} std (real and imaginary part)`);
    }
    if (data.element.views === VIEWS.length) parts.push(`coherence from SNR ${coherenceOf(one, state.q)[k].toFixed(3)}`);
    return parts.join("; ").replaceAll("-", "−");
  };

  const toldSingular = (k) => {
    const rank = Math.min(m, n);
    const sizes = (array, length, at) => Array.from({ length: rank }, (_, r) =>
      (DECIBELS * cut(array, state.q * rank + r, length)[at]).toFixed(1)).join(", ");
    const parts = [`${words(f[k], 4)} Hz`, `${names[state.q][0]} ${sizes(singular, F, k)} dB`];
    if (modelSingular) parts.push(`${names[state.q][1]} ${sizes(modelSingular, fine.length, line(k))} dB`);
    return parts.join("; ").replaceAll("-", "−");
  };

  const draw = () => {
    const one = element(state.q, state.i, state.j);
    const whole = state.view === SINGULAR;
    const [input, output] = [data.inputs[state.j], data.outputs[state.i]];
    const which = whole ? "" : column === "of" ? `, ${output} of ${input}` : `, ${column} ${input} to ${output}`;
    const where = `${noun[0].toUpperCase()}${noun.slice(1)} ${state.q + 1}`;
    const title = `${where}${which}: ${VIEWS[state.view]}`;
    for (const box of [toBox, fromBox, besideBox]) if (box) box.parentElement.hidden = whole;
    if (bandBox) bandBox.parentElement.hidden = state.view !== 0;
    for (const part of figure.querySelectorAll("[data-views]"))
      part.hidden = !part.dataset.views.includes(state.view);
    width = innerWidth < 640 ? 350 : 780;
    const svg = make("svg", { viewBox: `0 0 ${width + 80} 500`, role: "img", tabindex: 0, "aria-label": title });
    svg.style.setProperty("--width", width === 780 ? 600 : 300);
    const planes = DRAWINGS[state.view](svg, one);
    const cross = make("path", { stroke: "var(--ink)", "stroke-width": 0.8, fill: "none", "stroke-dasharray": "3 3" });
    svg.append(cross);
    let at = 0;
    const point = (k) => {
      at = Math.min(Math.max(k, 0), F - 1);
      const [{ points, across }] = planes;
      const d = points
        ? `M${points[at][0] - 6} ${points[at][1]}h12m-6-6v12`
        : planes.map(({ box: [, top, , height] }) => `M${across(f[at])} ${top}v${height}`).join("");
      cross.setAttribute("d", d);
      readout.textContent = whole ? toldSingular(at) : told(one, at);
    };
    svg.addEventListener("pointermove", (event) => {
      const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const [{ points, across }] = planes;
      const away = (k) => (points ? Math.hypot(points[k][0] - x, points[k][1] - y) : Math.abs(across(f[k]) - x));
      point(f.reduce((best, _, k) => (away(k) < away(best) ? k : best), 0));
    });
    svg.addEventListener("keydown", (event) => {
      const step = { ArrowRight: 1, ArrowLeft: -1 }[event.key];
      if (!step) return;
      point(at + step);
      event.preventDefault();
    });
    figure.querySelector(".title").textContent = title;
    holder.replaceChildren(svg);
    readout.textContent = "Point at a frequency for its values, or use the arrow keys.";
  };

  // The position that is chosen above; a panel that is clicked.
  data.ids.forEach((id, q) => {
    const choice = document.getElementById(id);
    const follow = () => {
      if (choice.classList.contains("chosen") && state.q !== q) (state.q = q), draw();
    };
    new MutationObserver(follow).observe(choice, { attributeFilter: ["class"] });
    if (choice.classList.contains("chosen")) state.q = q;
    const svg = choice.querySelector("svg[data-panels]");
    const [left, top, right, down, width, height] = JSON.parse(svg.dataset.panels);
    svg.addEventListener("click", (event) => {
      const { x, y } = new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
      const [j, i] = [Math.floor((x - left) / right), Math.floor((y - top) / down)];
      if (i < 0 || j < 0 || i >= m || j >= n || (x - left) % right > width || (y - top) % down > height) return;
      [state.i, state.j, toBox.value, fromBox.value] = [i, j, i, j];
      draw();
      figure.scrollIntoView({ block: "nearest", behavior: "smooth" });
    });
  });
  figure.hidden = false;
  draw();
})();
