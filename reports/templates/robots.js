// Pictures of the robot turn together: by mouse, touch and arrow keys. No network.
(() => {
  "use strict";
  const robots = [...document.querySelectorAll("svg[data-robot]")].map((svg) => ({
    svg,
    points: JSON.parse(svg.dataset.robot),
    radius: Number(svg.dataset.radius),
    modes: JSON.parse(svg.dataset.modes ?? "[]"),
    width: svg.viewBox.baseVal.width,
    lines: [...svg.querySelectorAll("path")].map((path) => path.getAttribute("stroke-width")),
  }));
  if (!robots.length) return;
  const [azimuth, elevation] = JSON.parse(robots[0].svg.dataset.view); // [deg]
  const start = { azimuth, elevation };
  const view = { ...start };
  const circle = (radius) =>
    Array.from({ length: 49 }, (_, i) => [
      radius * Math.cos((i * Math.PI) / 24), radius * Math.sin((i * Math.PI) / 24), 0,
    ]);

  // Right and down, without perspective.
  const camera = () => {
    const [a, e] = [view.azimuth, view.elevation].map((angle) => (angle * Math.PI) / 180);
    const [sa, ca, se, ce] = [Math.sin(a), Math.cos(a), Math.sin(e), Math.cos(e)];
    return ([x, y, z]) => [y * ca - x * sa, se * (x * ca + y * sa) - ce * z];
  };
  const turn = (azimuth, elevation) => {
    view.azimuth = ((azimuth + 540) % 360) - 180;
    view.elevation = Math.min(90, Math.max(0, elevation));
    draw();
  };
  // A mode moves the points about where they rest.
  const moving = { mode: -1, phase: 0 };
  const deflected = ({ points, modes, radius }) => {
    const shape = modes[moving.mode];
    if (!shape) return points;
    const amplitude = 0.1 * radius * Math.sin(moving.phase);
    return points.map((point, i) => point.map((v, k) => v + amplitude * shape[1][i][k]));
  };
  const draw = () => {
    const seen = camera();
    const words = (point) => seen(point).map((v) => v.toFixed(3)).join(" ");
    const line = (points) => "M" + points.map(words).join("L");
    const dots = (points) => points.map((point) => `M${words(point)}h0`).join("");
    const all = [...robots.flatMap((robot) => robot.points), ...circle(robots[0].radius)].map(seen);
    const [left, top] = [0, 1].map((i) => Math.min(...all.map((p) => p[i])));
    const [right, bottom] = [0, 1].map((i) => Math.max(...all.map((p) => p[i])));
    const margin = 0.04 * Math.max(right - left, bottom - top);
    const box = [left - margin, top - margin, right - left + 2 * margin, bottom - top + 2 * margin];
    for (const robot of robots) {
      const { svg, radius } = robot;
      const points = deflected(robot);
      // The frame stays as large as it was, and what is seen is fitted into it.
      if (!svg.style.aspectRatio) {
        const { width, height } = svg.viewBox.baseVal;
        svg.style.aspectRatio = `${width} / ${height}`;
        robot.shape = width / height;
      }
      const rim = circle(radius);
      const middle = points.slice(1, -1);
      const drawn = {
        floor: [rim, circle(radius / 2), [rim[0], rim[24]], [rim[12], rim[36]]].map(line).join(""),
        shadow: line(points.map(([x, y]) => [x, y, 0])),
        links: line(points),
        joints: dots(middle),
        pins: dots(middle),
        tool: dots(points.slice(-1)),
      };
      const wider = Math.max(box[2], robot.shape * box[3]) / robot.width;
      svg.setAttribute("viewBox", box.map((v) => v.toFixed(3)).join(" "));
      svg.querySelectorAll("path").forEach((path, i) => {
        path.setAttribute("d", drawn[path.getAttribute("class")]);
        path.setAttribute("stroke-width", (wider * robot.lines[i]).toFixed(4));
      });
    }
  };

  const most = Math.max(...robots.map((robot) => robot.modes.length));
  const bar = document.getElementById("modes-shown");
  if (bar && most) {
    const label = document.createElement("label");
    const select = document.createElement("select");
    select.setAttribute("aria-label", "mode");
    label.append("mode ", select);
    select.append(new Option("none", 0));
    for (let mode = 1; mode <= most; mode++) select.append(new Option(mode, mode));
    bar.append(label);
    const still = matchMedia("(prefers-reduced-motion: reduce)");
    let frame = 0;
    const animate = (time) => {
      moving.phase = still.matches ? Math.PI / 2 : time / 400;
      draw();
      if (!still.matches) frame = requestAnimationFrame(animate);
    };
    select.addEventListener("change", () => {
      cancelAnimationFrame(frame);
      moving.mode = Number(select.value) - 1;
      for (const { svg, modes } of robots) {
        const [frequency] = modes[moving.mode] ?? [];
        const told = svg.closest("figure")?.querySelector(".mode");
        if (told) told.textContent = frequency === undefined ? "" : `${frequency} Hz`;
      }
      if (moving.mode < 0) draw();
      else animate(0);
    });
  }

  const keys = {
    ArrowLeft: [-10, 0], ArrowRight: [10, 0], ArrowUp: [0, 10], ArrowDown: [0, -10],
  };
  for (const { svg } of robots) {
    svg.tabIndex = 0;
    svg.classList.add("turns");
    svg.addEventListener("keydown", (event) => {
      if (event.key === "Home") turn(start.azimuth, start.elevation);
      else if (keys[event.key]) {
        const [across, up] = keys[event.key];
        turn(view.azimuth + across, view.elevation + up);
      } else return;
      event.preventDefault();
    });
    let from = null;
    svg.addEventListener("pointerdown", (event) => {
      if (event.button) return;
      from = [event.clientX, event.clientY];
      svg.setPointerCapture(event.pointerId);
    });
    svg.addEventListener("pointermove", (event) => {
      if (!from) return;
      const [across, down] = [event.clientX - from[0], event.clientY - from[1]];
      from = [event.clientX, event.clientY];
      turn(view.azimuth - 0.8 * across, view.elevation + 0.8 * down);
    });
    for (const end of ["pointerup", "pointercancel"]) svg.addEventListener(end, () => (from = null));
    svg.addEventListener("dblclick", () => turn(start.azimuth, start.elevation));
  }
})();
