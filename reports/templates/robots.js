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
    if (!element || !("DecompressionStream" in window)) return;
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
  // Colours the pixels of a triangle: where it is nearest; without depths where nothing is yet.
  const fill = (x, y, i, j, k, colour, { colours, nearest, width, height }, depth) => {
    const [ux, uy, wx, wy] = [x[j] - x[i], y[j] - y[i], x[k] - x[i], y[k] - y[i]];
    const area = ux * wy - wx * uy;
    if (!area) return;
    const left = Math.max(0, Math.ceil(Math.min(x[i], x[j], x[k])));
    const top = Math.max(0, Math.ceil(Math.min(y[i], y[j], y[k])));
    const right = Math.min(width - 1, Math.max(x[i], x[j], x[k]));
    const bottom = Math.min(height - 1, Math.max(y[i], y[j], y[k]));
    for (let row = top; row <= bottom; row++)
      for (let column = left; column <= right; column++) {
        const b = ((column - x[i]) * wy - wx * (row - y[i])) / area;
        const c = (ux * (row - y[i]) - (column - x[i]) * uy) / area;
        if (b < 0 || c < 0 || b + c > 1) continue;
        const spot = row * width + column;
        if (!depth) colours[spot] ||= colour;
        else {
          const near = depth[i] + b * (depth[j] - depth[i]) + c * (depth[k] - depth[i]);
          if (near < nearest[spot]) continue;
          nearest[spot] = near;
          colours[spot] = colour;
        }
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
      const point = places.subarray(3 * v, 3 * v + 3);
      [x[v], y[v]] = at(seen(point));
      below[v] = y[v] + scale * point[2] * Math.cos(e); // on the floor
      depth[v] = eye[0] * point[0] + eye[1] * point[1] + eye[2] * point[2];
    }
    const pen = canvas.getContext("2d");
    const image = pen.createImageData(width, height);
    const onto = {
      colours: new Uint32Array(image.data.buffer),
      nearest: new Float32Array(width * height).fill(-Infinity),
      width, height,
    };
    const [base, triangles] = [svg.closest(".outlying") ? ORANGE : STEEL, bodies.triangles];
    const [sine, cosine] = [Math.sin(a), Math.cos(a)];
    for (let t = 0; t < total; t++) {
      const i = triangles[t], j = triangles[total + t], k = triangles[2 * total + t];
      const ux = places[3 * j] - places[3 * i], wx = places[3 * k] - places[3 * i];
      const uy = places[3 * j + 1] - places[3 * i + 1], wy = places[3 * k + 1] - places[3 * i + 1];
      const uz = places[3 * j + 2] - places[3 * i + 2], wz = places[3 * k + 2] - places[3 * i + 2];
      const nx = uy * wz - uz * wy, ny = uz * wx - ux * wz, nz = ux * wy - uy * wx;
      if (nz > 0) fill(x, below, i, j, k, SHADOW, onto);
      const size = Math.sqrt(nx * nx + ny * ny + nz * nz) || 1;
      const facing = (nx * eye[0] + ny * eye[1] + nz * eye[2]) / size;
      if (facing <= 0) continue;
      // Light from the upper left behind the eye.
      const right = (ny * cosine - nx * sine) / size;
      const bright = 0.45 + 0.65 * Math.max(0, 0.6 * facing + 0.55 * (nz / size) - 0.35 * right);
      const red = Math.min(255, base[0] * bright), green = Math.min(255, base[1] * bright);
      const blue = Math.min(255, base[2] * bright);
      fill(x, y, i, j, k, (0xff000000 | (blue << 16) | (green << 8) | red) >>> 0, onto, depth);
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
  const groups = new Map();
  for (const robot of robots) {
    const beside = robot.svg.closest(".poses") ?? robot.svg;
    groups.set(beside, [...(groups.get(beside) ?? []), robot]);
  }
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
        const words = parsed(told?.dataset.modes)[moving.mode] ?? `${frequency} Hz, motors free`;
        if (told) told.textContent = frequency === undefined ? "" : words;
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
