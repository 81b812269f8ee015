"use strict";
/* What the player draws: views of the world and curves over time. */

const LETTERS = ["x", "y", "z"];
const NEAR = 6; // m from the robot to the rim of the near view
const THIRD = 3; // steps from one drawn region to the next, unless each is asked for
const LEAST = 40; // pixels; in less there is nothing to see
const CUT = 5; // m; a clearance beyond this is drawn at this height

/** One view of the world: two of its coordinates, at the same scale. */
class View {
  constructor(place, episode, number) {
    this.episode = episode;
    this.number = number;
    this.axes = episode.axes[number];
    const canvas = document.createElement("canvas");
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", `Agents, plan and forecast regions, ${this.name()}`);
    place.append(canvas);
    this.canvas = canvas;
  }

  name() {
    return this.axes[1] === 1 ? "seen from above" : "seen from the side";
  }

  draw(state, colors) {
    const box = this.box(state);
    const wide = this.canvas.clientWidth - 44;
    if (wide < LEAST) return;
    const shape = (box[3] - box[1]) / (box[2] - box[0]);
    const most = Math.max(220, 0.62 * window.innerHeight);
    const { context, width, height } = prepared(
      this.canvas, Math.round(Math.min(Math.max(wide * shape, 150), most)) + 30,
    );
    const [left, top, right, bottom] = [36, 6, width - 8, height - 24];
    const scale = Math.min((right - left) / (box[2] - box[0]), (bottom - top) / (box[3] - box[1]));
    // The world's coordinates of the lower left corner.
    const low = [
      0.5 * (box[0] + box[2] - (right - left) / scale),
      0.5 * (box[1] + box[3] - (bottom - top) / scale),
    ];
    Object.assign(this, { context, colors, scale });
    this.toX = (x) => left + scale * (x - low[0]);
    this.toY = (y) => bottom - scale * (y - low[1]);
    this.grid(left, top, right, bottom, low);
    context.save();
    context.beginPath();
    context.rect(left, top, right - left, bottom - top);
    context.clip();
    this.still(state);
    if (state.trails) this.trails(state);
    const plan = planAt(state.robot, state.time);
    if (plan) this.forecast(plan, state);
    if (plan && state.plan) this.plan(plan, state.robot);
    for (const agent of this.episode.agents) this.body(agent, state);
    context.restore();
  }

  box(state) {
    const all = this.episode.extent[this.number];
    const here = this.at(state.robot, state.index);
    if (!state.near || !Number.isFinite(here[0])) return all;
    return [here[0] - NEAR, here[1] - NEAR, here[0] + NEAR, here[1] + NEAR];
  }

  at(agent, index) {
    return this.axes.map((axis) => agent.positions[axis][index]);
  }

  grid(left, top, right, bottom, low) {
    const { context: c, colors, scale } = this;
    const [wide, high] = [(right - left) / scale, (bottom - top) / scale];
    const count = 8 / Math.max(wide, high);
    c.strokeStyle = colors.line;
    c.fillStyle = colors.muted;
    c.strokeRect(left, top, right - left, bottom - top);
    c.beginPath();
    c.textBaseline = "top";
    c.textAlign = "center";
    for (const x of ticks(low[0], low[0] + wide, count * wide)) {
      c.moveTo(this.toX(x), top);
      c.lineTo(this.toX(x), bottom);
      if (this.toX(x) < right - 46) c.fillText(String(x), this.toX(x), bottom + 5);
    }
    c.textAlign = "right";
    c.fillText(`${LETTERS[this.axes[0]]} (m)`, right, bottom + 5);
    c.textBaseline = "middle";
    for (const y of ticks(low[1], low[1] + high, count * high)) {
      c.moveTo(left, this.toY(y));
      c.lineTo(right, this.toY(y));
      if (this.toY(y) > top + 20) c.fillText(String(y), left - 5, this.toY(y));
    }
    c.stroke();
    c.fillText(`${LETTERS[this.axes[1]]} (m)`, left - 2, top + 6);
  }

  line(xs, ys, from = 0, to = xs.length) {
    const { context: c } = this;
    let open = false;
    c.beginPath();
    for (let i = from; i < to; i += 1) {
      if (!Number.isFinite(xs[i])) {
        open = false;
      } else if (open) {
        c.lineTo(this.toX(xs[i]), this.toY(ys[i]));
      } else {
        c.moveTo(this.toX(xs[i]), this.toY(ys[i]));
        open = true;
      }
    }
  }

  dots(xs, ys, radius, filled) {
    const { context: c } = this;
    for (let i = 0; i < xs.length; i += 1) {
      c.beginPath();
      c.arc(this.toX(xs[i]), this.toY(ys[i]), radius, 0, 2 * Math.PI);
      if (filled) c.fill(); else c.stroke();
    }
  }

  still(state) {
    const { context: c, colors, axes: [a, b] } = this;
    c.fillStyle = colors.wall;
    c.strokeStyle = colors.muted;
    for (const polygon of b === 1 ? this.episode.polygons : []) {
      this.line(...polygon.points);
      c.closePath();
      c.fill();
      c.stroke();
    }
    for (const robot of this.episode.agents.filter((agent) => agent.kind === "robot")) {
      const path = robot.paths.filter((one) => one.begin <= state.time + 1e-9).at(-1);
      if (!path) continue;
      c.strokeStyle = robot === state.robot ? colors.reference : colors.line;
      c.lineWidth = 1.2;
      this.line(path.points[a], path.points[b]);
      c.stroke();
      c.strokeStyle = colorOf(robot, colors);
      const x = this.toX(path.points[a].at(-1)), y = this.toY(path.points[b].at(-1));
      c.beginPath();
      for (const [i, j] of [[-4, -4], [-4, 4]]) {
        c.moveTo(x + i, y + j);
        c.lineTo(x - i, y - j);
      }
      c.stroke();
    }
  }

  trails(state) {
    const { context: c, axes: [a, b] } = this;
    c.lineWidth = 1.2;
    c.globalAlpha = 0.7;
    for (const agent of this.episode.agents) {
      c.strokeStyle = colorOf(agent, this.colors);
      c.setLineDash(agent.kind === "robot" ? [] : [2, 3]);
      this.line(agent.positions[a], agent.positions[b], 0, state.index + 1);
      c.stroke();
    }
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  forecast(plan, state) {
    const { context: c, colors, axes: [a, b] } = this;
    for (const one of plan.forecast) {
      c.strokeStyle = c.fillStyle = colors.region;
      const shade = 0.35 + 0.65 * one.weight;
      const [long, short, angle] = one.ellipses[this.number];
      const room = state.robot.room === null ? null : state.robot.room + one.radius;
      for (let i = 0; i < long.length; i += 1) {
        const held = one.held[i], scale = state.regions === "held" ? held : 1;
        const skipped = !state.each && (long.length - 1 - i) % THIRD !== 0;
        if (state.enlarged && (!skipped || this.episode.apart > 1)) this.rim(one.sets[i], shade);
        if (skipped) continue;
        const place = [this.toX(one.mean[a][i]), this.toY(one.mean[b][i])];
        const axes = (times, more) => [times * long[i] + more, times * short[i] + more];
        c.lineWidth = 1;
        if (state.regions !== "none" && Number.isFinite(scale)) {
          this.ellipse(place, axes(scale, 0), angle[i], 0.06 * shade, 0.3 * shade);
        }
        const known = this.episode.region !== null || this.episode.axes.length > 1;
        if (!state.enlarged || room === null || known || !Number.isFinite(held)) continue;
        c.lineWidth = 1.4;
        this.ellipse(place, axes(held, room), angle[i], 0, 0.9 * shade);
      }
      c.lineWidth = 1;
      c.globalAlpha = shade;
      this.line(one.mean[a], one.mean[b]);
      c.stroke();
      this.dots(one.mean[a], one.mean[b], 1.6, true);
      c.globalAlpha = 1;
    }
  }

  /** What the plan keeps out of at one step, where that is known. */
  rim(points, shade) {
    if (!points) return;
    const { context: c } = this;
    this.line(...points);
    c.closePath();
    c.lineWidth = 1.4;
    c.globalAlpha = 0.9 * shade;
    c.stroke();
    c.globalAlpha = 1;
  }

  ellipse(place, axes, angle, fill, edge) {
    const { context: c, scale } = this;
    c.beginPath();
    c.ellipse(...place, ...axes.map((axis) => scale * axis), -angle, 0, 2 * Math.PI);
    c.globalAlpha = fill;
    if (fill) c.fill();
    c.globalAlpha = edge;
    c.stroke();
    c.globalAlpha = 1;
  }

  plan(plan, robot) {
    const { context: c, colors, axes: [a, b] } = this;
    c.lineWidth = 1;
    c.strokeStyle = colors.reference;
    this.dots(plan.reference[a], plan.reference[b], 3.4, false);
    c.strokeStyle = c.fillStyle = colorOf(robot, colors);
    this.line(plan.positions[a], plan.positions[b]);
    c.stroke();
    this.dots(plan.positions[a].slice(1), plan.positions[b].slice(1), 2.2, true);
  }

  body(agent, state) {
    const { context: c, colors, axes } = this;
    const here = this.at(agent, state.index);
    if (!here.every(Number.isFinite)) return;
    const heading = agent.headings[state.index];
    const turn = Number.isFinite(heading) && axes[1] === 1 ? heading : 0;
    const [cos, sin] = [Math.cos(turn), Math.sin(turn)];
    const put = ([x, y]) => [here[0] + cos * x - sin * y, here[1] + sin * x + cos * y];
    c.strokeStyle = c.fillStyle = colorOf(agent, colors);
    c.lineWidth = agent === state.robot ? 2.2 : 1.3;
    c.beginPath();
    for (const part of agent.parts) {
      if (part.corners) {
        const [first, ...rest] = part.corners.map(put).map(([x, y]) => [this.toX(x), this.toY(y)]);
        c.moveTo(...first);
        for (const corner of rest) c.lineTo(...corner);
        c.closePath();
      } else {
        const [x, y] = put(part.at);
        c.moveTo(this.toX(x + part.radius), this.toY(y));
        c.arc(this.toX(x), this.toY(y), this.scale * part.radius, 0, 2 * Math.PI);
      }
    }
    c.globalAlpha = 0.25;
    c.fill();
    c.globalAlpha = 1;
    if (Number.isFinite(heading) && axes[1] === 1) {
      c.moveTo(this.toX(here[0]), this.toY(here[1]));
      const [x, y] = put([agent.radius, 0]);
      c.lineTo(this.toX(x), this.toY(y));
    }
    c.stroke();
    if (agent.kind !== "robot") return;
    c.textAlign = "center";
    c.textBaseline = "bottom";
    c.lineWidth = 3;
    c.strokeStyle = colors.paper;
    const above = [this.toX(here[0]), this.toY(here[1] + agent.radius) - 3];
    c.strokeText(agent.name, ...above);
    c.fillText(agent.name, ...above);
  }
}

/** A quantity of the chosen robot over time, with a cursor. */
class Chart {
  constructor(place, name, unit, quantity, jump) {
    Object.assign(this, { name, unit, quantity });
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${name} over time`);
    this.canvas.addEventListener("click", (event) => {
      const { left, width } = this.canvas.getBoundingClientRect();
      jump((event.clientX - left - 36) / (width - 44));
    });
    place.append(this.canvas);
  }

  draw(state, colors) {
    if (this.canvas.clientWidth - 44 < LEAST) return;
    const { context: c, width, height } = prepared(this.canvas);
    const times = state.episode.frames, end = times.at(-1) || 1;
    const values = state.robot[this.quantity].map((value) => Math.min(value, CUT));
    const known = values.filter(Number.isFinite);
    const low = Math.min(0, ...known.length ? [known.reduce((p, q) => Math.min(p, q))] : []);
    const high = Math.max(low + 0.5, known.reduce((p, q) => Math.max(p, q), low)) * 1.05;
    const [left, right, top, bottom] = [36, width - 8, 20, height - 18];
    const toX = (t) => left + (right - left) * t / end;
    const toY = (v) => bottom - (bottom - top) * (v - low) / (high - low);
    c.strokeStyle = colors.line;
    c.fillStyle = colors.muted;
    c.strokeRect(left, top, right - left, bottom - top);
    c.textAlign = "left";
    c.textBaseline = "bottom";
    const cut = known.some((value) => value >= CUT) ? `, cut off at ${CUT}` : "";
    c.fillText(`${this.name} (${this.unit})${cut}`, left, top - 4);
    c.textAlign = "right";
    c.textBaseline = "middle";
    c.beginPath();
    for (const value of ticks(low, high, 3)) {
      c.moveTo(left, toY(value));
      c.lineTo(right, toY(value));
      c.fillText(String(value), left - 5, toY(value));
    }
    c.stroke();
    c.textAlign = "center";
    c.textBaseline = "top";
    for (const t of ticks(0, end, Math.max(3, Math.min(8, width / 80)))) {
      if (toX(t) < right - 42) c.fillText(String(t), toX(t), bottom + 4);
    }
    c.textAlign = "right";
    c.fillText("t (s)", right, bottom + 4);
    c.strokeStyle = colorOf(state.robot, colors);
    c.lineWidth = 1.5;
    c.beginPath();
    values.forEach((value, i) => {
      const kind = i && Number.isFinite(values[i - 1]) ? "lineTo" : "moveTo";
      if (Number.isFinite(value)) c[kind](toX(times[i]), toY(value));
    });
    c.stroke();
    c.strokeStyle = colors.ink;
    c.beginPath();
    c.moveTo(toX(state.time), top);
    c.lineTo(toX(state.time), bottom);
    c.stroke();
  }
}

const GRADES = ["optimal", "gave way", "not optimal"];

/** How every plan of the chosen robot came about: the higher and darker a bar, the worse. */
class Strip {
  constructor(place, jump) {
    this.canvas = document.createElement("canvas");
    this.words = document.createElement("p");
    this.words.className = "quiet";
    this.canvas.setAttribute("role", "img");
    this.canvas.addEventListener("click", (event) => {
      const { left, width } = this.canvas.getBoundingClientRect();
      jump((event.clientX - left) / width);
    });
    place.append(this.canvas, this.words);
  }

  draw({ episode, robot, time }, colors) {
    const { plans, stamps } = robot;
    this.canvas.hidden = this.words.hidden = !plans.length;
    if (!plans.length || this.canvas.clientWidth < LEAST) return;
    const grades = plans.map(grade), end = episode.frames.at(-1) || 1;
    const counts = GRADES.map((_, i) => grades.filter((one) => one === i).length);
    const words = counts.map((count, i) => `${count} ${GRADES[i]}`).join(", ");
    this.words.textContent = `${plans.length} plans: ${words}`;
    this.canvas.setAttribute("aria-label", this.words.textContent);
    const { context: c, width, height } = prepared(this.canvas, 18);
    const toX = (t) => width * t / end;
    grades.forEach((one, i) => {
      const high = [2, 9, height][one], until = stamps[i + 1] ?? end;
      c.fillStyle = colors[["line", "gave-way", "lower"][one]];
      c.fillRect(toX(stamps[i]), height - high, toX(until) - toX(stamps[i]) + 0.8, high);
    });
    c.fillStyle = colors.ink;
    c.fillRect(toX(time) - 1, 0, 2, height);
  }
}
