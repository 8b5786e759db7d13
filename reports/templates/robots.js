// Pictures of the robot turn together: by mouse, touch and arrow keys. No network.
(() => {
  "use strict";
  const parsed = (words) => JSON.parse(words ?? "[]");
  const robots = [...document.querySelectorAll("svg[data-robot]")].map((svg) => ({
    svg,
    points: parsed(svg.dataset.robot),
    marks: parsed(svg.dataset.marks),
    joints: parsed(svg.dataset.joints),
    radius: Number(svg.dataset.radius),
    modes: parsed(svg.dataset.modes),
    width: svg.viewBox.baseVal.width,
    lines: [...svg.querySelectorAll("path")].map((path) => path.getAttribute("stroke-width")),
    letters: Number(svg.querySelector("text")?.getAttribute("font-size")),
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
  // A mode moves points and links about where they rest.
  const moving = { mode: -1, phase: 0 };
  const amplitude = (robot) => 0.1 * robot.radius * Math.sin(moving.phase);
  const deflected = (robot) => {
    const shape = robot.modes[moving.mode];
    if (!shape) return robot.points;
    return robot.points.map((point, i) => point.map((v, k) => v + amplitude(robot) * shape[1][i][k]));
  };

  // Surfaces of the links, if there are any: corners, their joints, triangles.
  let bodies = null;
  const load = async () => {
    const element = document.getElementById("robot-bodies");
    if (!element) return;
    const data = JSON.parse(element.textContent);
    const [corners, triangles] = data.counts;
    bodies = {
      corners: await unpacked(data.vertices, corners),
      joints: await unpacked(data.joints, corners),
      triangles: await unpacked(data.faces, triangles),
    };
    for (const robot of robots.filter(({ joints }) => joints.length)) {
      const box = document.createElement("div");
      robot.canvas = document.createElement("canvas");
      robot.canvas.setAttribute("aria-hidden", "true");
      box.className = "solid";
      robot.svg.replaceWith(box);
      box.append(robot.canvas, robot.svg);
    }
    draw();
    addEventListener("resize", draw);
  };
  // Corners in space: of its joint, and of its mode's movement and rotation of that.
  const placed = (robot, size) => {
    const { corners, joints } = bodies, count = joints.length;
    const twists = robot.modes[moving.mode]?.[2];
    const places = new Float64Array(3 * count);
    for (let v = 0; v < count; v++) {
      const rows = robot.joints[joints[v]], twist = twists?.[joints[v]];
      const [x, y, z] = [corners[v], corners[count + v], corners[2 * count + v]];
      const arm = rows.map((row) => row[0] * x + row[1] * y + row[2] * z);
      for (let k = 0; k < 3; k++) {
        const [p, q] = [(k + 1) % 3, (k + 2) % 3];
        const moved = twist ? size * (twist[k] + twist[3 + p] * arm[q] - twist[3 + q] * arm[p]) : 0;
        places[3 * v + k] = rows[k][3] + arm[k] + moved;
      }
    }
    return places;
  };
  // Pixels of a triangle, with weights of its corners.
  const pixels = (x, y, [i, j, k], width, height, each) => {
    const area = (x[j] - x[i]) * (y[k] - y[i]) - (x[k] - x[i]) * (y[j] - y[i]);
    if (!area) return;
    const [left, top] = [x, y].map((c) => Math.max(0, Math.ceil(Math.min(c[i], c[j], c[k]))));
    const right = Math.min(width - 1, Math.max(x[i], x[j], x[k]));
    const bottom = Math.min(height - 1, Math.max(y[i], y[j], y[k]));
    for (let row = top; row <= bottom; row++)
      for (let column = left; column <= right; column++) {
        const b = ((column - x[i]) * (y[k] - y[i]) - (x[k] - x[i]) * (row - y[i])) / area;
        const c = ((x[j] - x[i]) * (row - y[i]) - (column - x[i]) * (y[j] - y[i])) / area;
        if (b >= 0 && c >= 0 && b + c <= 1) each(row * width + column, 1 - b - c, b, c);
      }
  };
  const STEEL = [152, 166, 184], ORANGE = [222, 142, 92], SHADOW = 0x60807870;
  // Floor, shadow and links, by a buffer of depths; the colours suit light and dark pages.
  const paint = (robot, box, seen, floor) => {
    const { canvas, svg } = robot;
    const dots = Math.max(2, devicePixelRatio);
    const width = (canvas.width = Math.round(dots * svg.clientWidth));
    const height = (canvas.height = Math.round(dots * svg.clientHeight));
    if (!width || !height) return;
    const scale = Math.min(width / box[2], height / box[3]);
    const [across, down] = [(width - scale * box[2]) / 2, (height - scale * box[3]) / 2];
    const at = ([x, y]) => [across + scale * (x - box[0]), down + scale * (y - box[1])];
    const places = placed(robot, amplitude(robot));
    const count = bodies.joints.length, total = bodies.triangles.length / 3;
    const [a, e] = [view.azimuth, view.elevation].map((angle) => (angle * Math.PI) / 180);
    const eye = [Math.cos(e) * Math.cos(a), Math.cos(e) * Math.sin(a), Math.sin(e)];
    const [x, y, below, depth] = Array.from({ length: 4 }, () => new Float64Array(count));
    for (let v = 0; v < count; v++) {
      const [px, py, pz] = places.subarray(3 * v, 3 * v + 3);
      [x[v], y[v]] = at(seen([px, py, pz]));
      below[v] = y[v] + scale * pz * Math.cos(e); // on the floor
      depth[v] = eye[0] * px + eye[1] * py + eye[2] * pz;
    }
    const pen = canvas.getContext("2d");
    const image = pen.createImageData(width, height);
    const colours = new Uint32Array(image.data.buffer);
    const nearest = new Float32Array(width * height).fill(-Infinity);
    const colour = svg.closest(".outlying") ? ORANGE : STEEL;
    for (let t = 0; t < total; t++) {
      const corners = [0, 1, 2].map((k) => bodies.triangles[k * total + t]);
      const [i, j, k] = corners;
      const [u, w] = [j, k].map((end) => [0, 1, 2].map((n) => places[3 * end + n] - places[3 * i + n]));
      const normal = [u[1] * w[2] - u[2] * w[1], u[2] * w[0] - u[0] * w[2], u[0] * w[1] - u[1] * w[0]];
      const size = Math.hypot(...normal) || 1;
      if (normal[2] > 0)
        pixels(x, below, corners, width, height, (spot) => { colours[spot] ||= SHADOW; });
      const facing = (normal[0] * eye[0] + normal[1] * eye[1] + normal[2] * eye[2]) / size;
      if (facing <= 0) continue;
      // Light from the upper left behind the eye.
      const right = (normal[1] * Math.cos(a) - normal[0] * Math.sin(a)) / size;
      const bright = 0.45 + 0.65 * Math.max(0, 0.6 * facing + 0.55 * (normal[2] / size) - 0.35 * right);
      const [red, green, blue] = colour.map((value) => Math.min(255, Math.round(value * bright)));
      const shade = (0xff000000 | (blue << 16) | (green << 8) | red) >>> 0;
      pixels(x, y, corners, width, height, (spot, p, q, r) => {
        const near = p * depth[i] + q * depth[j] + r * depth[k];
        if (near < nearest[spot]) return;
        nearest[spot] = near;
        colours[spot] = shade;
      });
    }
    pen.putImageData(image, 0, 0);
    pen.globalCompositeOperation = "destination-over";
    pen.lineWidth = 0.8 * dots;
    pen.strokeStyle = "rgb(128 138 148 / 45%)";
    pen.beginPath();
    for (const line of floor) line.forEach((point, k) => pen[k ? "lineTo" : "moveTo"](...at(seen(point))));
    pen.stroke();
  };
  // What is seen of pictures side by side; they have one scale.
  const groups = Map.groupBy(robots, ({ svg }) => svg.closest(".poses") ?? svg);
  const frame = (group, seen) => {
    const ends = [Infinity, Infinity, -Infinity, -Infinity];
    const include = (point) => {
      const [x, y] = seen(point);
      ends[0] = Math.min(ends[0], x);
      ends[1] = Math.min(ends[1], y);
      ends[2] = Math.max(ends[2], x);
      ends[3] = Math.max(ends[3], y);
    };
    for (const robot of group) {
      [...robot.points, ...circle(robot.radius)].forEach(include);
      if (!robot.canvas) continue;
      robot.rest ??= placed(robot, 0);
      for (let v = 0; v < robot.rest.length; v += 3) include(robot.rest.subarray(v, v + 3));
    }
    const margin = 0.04 * Math.max(ends[2] - ends[0], ends[3] - ends[1]);
    return [ends[0] - margin, ends[1] - margin, ends[2] - ends[0] + 2 * margin, ends[3] - ends[1] + 2 * margin];
  };
  const draw = () => {
    for (const group of groups.values()) drawn(group);
  };
  const drawn = (group) => {
    const seen = camera();
    const words = (point) => seen(point).map((v) => v.toFixed(3)).join(" ");
    const line = (points) => "M" + points.map(words).join("L");
    const dots = (points) => points.map((point) => `M${words(point)}h0`).join("");
    const box = frame(group, seen);
    for (const robot of group) {
      const { svg, radius } = robot;
      const points = deflected(robot);
      // The frame stays as large as it was, and what is seen is fitted into it.
      if (!svg.style.aspectRatio) {
        const { width, height } = svg.viewBox.baseVal;
        svg.style.aspectRatio = `${width} / ${height}`;
        robot.shape = width / height;
      }
      const ring = circle(radius);
      const floor = [ring, circle(radius / 2), [ring[0], ring[24]], [ring[12], ring[36]]];
      const middle = points.slice(1, -1);
      const paths = {
        floor: floor.map(line).join(""),
        shadow: line(points.map(([x, y]) => [x, y, 0])),
        links: line(points),
        joints: dots(middle),
        pins: dots(middle),
        tool: dots(points.slice(-1)),
        marks: dots(robot.marks),
      };
      const wider = Math.max(box[2], robot.shape * box[3]) / robot.width;
      svg.setAttribute("viewBox", box.map((v) => v.toFixed(3)).join(" "));
      svg.querySelectorAll("path").forEach((path, i) => {
        path.setAttribute("d", paths[path.getAttribute("class")]);
        path.setAttribute("stroke-width", (wider * robot.lines[i]).toFixed(4));
      });
      svg.querySelectorAll("text").forEach((number, i) => {
        const [x, y] = seen(robot.marks[i]).map((v) => v.toFixed(3));
        for (const [name, value] of [["x", x], ["y", y]]) number.setAttribute(name, value);
        number.setAttribute("font-size", (wider * robot.letters).toFixed(4));
      });
      const { top, bottom } = svg.getBoundingClientRect();
      const hidden = moving.playing && (bottom < 0 || top > innerHeight);
      if (robot.canvas && !hidden) paint(robot, box, seen, floor);
    }
  };
  load();

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
    const sized = document.createElement("label");
    const size = document.createElement("select");
    size.setAttribute("aria-label", "size");
    sized.append("size ", size);
    size.append(new Option("small", 0), new Option("large", 1));
    bar.append(sized);
    size.addEventListener("change", () => {
      robots[0].svg.closest(".poses").classList.toggle("larger", size.value === "1");
      draw();
    });
    const still = matchMedia("(prefers-reduced-motion: reduce)");
    let frame = 0;
    const animate = (time) => {
      moving.playing = !still.matches;
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
      moving.playing = false;
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
