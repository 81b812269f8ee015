"use strict";
/* The player's controls. */

class Player {
  constructor(element) {
    this.element = element;
    this.sources = [...element.querySelectorAll("script.episode")];
    element.append(document.getElementById("player").content.cloneNode(true));
    this.part = (name) => element.querySelector(`.${name}`);
    this.choice();
    this.listen();
    this.load(0);
  }

  /** Several episodes open with a choice: what differs between them, and how each ended. */
  choice() {
    this.part("which").append(...this.sources.map((source, i) => {
      const label = document.createElement("label"), input = document.createElement("input");
      const name = document.createElement("b"), note = document.createElement("small");
      if (source.dataset.note.endsWith("contact")) label.className = "flagged";
      Object.assign(input, { type: "radio", name: "run", value: i, checked: i === 0 });
      input.addEventListener("change", () => this.load(i));
      [name.textContent, note.textContent] = [source.dataset.label, source.dataset.note];
      label.append(input, name, note);
      return label;
    }));
    this.part("which").hidden = this.sources.length < 2;
  }

  async load(number) {
    this.pause();
    const { title, note } = this.sources[number].dataset;
    this.part("what").textContent = `${title}; ${note}`;
    document.title = title;
    try {
      this.episode = await unpack(this.sources[number].textContent);
    } catch (error) {
      this.part("facts").textContent =
        `This browser cannot unpack the episode (${error}). Take one of 2023 or later.`;
      return;
    }
    const { episode } = this;
    this.robots = episode.agents.filter((agent) => agent.kind === "robot");
    const options = this.robots.map((robot, i) => new Option(robot.name, i));
    this.part("robot").replaceChildren(...options);
    this.part("regions").options[0].text = `of content ${+(100 * episode.content).toFixed(4)} %`;
    for (const name of ["views", "charts", "strip"]) this.part(name).replaceChildren();
    this.views = episode.axes.map((_, i) => new View(this.part("views"), episode, i));
    const jump = (share) => this.show(lastAtMost(episode.frames, share * episode.frames.at(-1)));
    const charts = this.part("charts");
    this.charts = [
      new Chart(charts, "clearance", "m", "clearance", jump),
      new Chart(charts, "speed", "m/s", "speeds", jump),
      new Strip(this.part("strip"), jump),
    ];
    this.part("time").max = episode.frames.length - 1;
    this.show(0);
    this.element.dataset.ready = "yes";
  }

  key() {
    const items = [
      ["reference", "reference path and points"], ["region", "forecast means", "dotted"],
      ["region", "regions of the forecast, not enlarged", "solid", "pale"],
    ];
    const robot = this.robots[this.part("robot").selectedIndex];
    const { region } = this.episode, flat = this.episode.axes.length === 1;
    const enlarged = flat && (region !== null || robot.room !== null);
    const words = region === null
      ? "at the plan's level, enlarged by r + r_d, as the paper's region is"
      : `kept out of at the plan's level: ${region}`;
    this.part("enlarged").parentElement.hidden = !enlarged;
    this.part("each").parentElement.hidden = this.episode.every > 1;
    if (enlarged) items.push(["region", words]);
    if (!robot.plans.length) items.splice(1);
    items.push([`robot-${robot.color}`, `${robot.name}, its plan and trail`]);
    items.push(["other", "others", "dotted"]);
    const lines = items.map(([color, text, style, pale]) => {
      const line = document.createElement("li"), mark = document.createElement("i");
      mark.style.opacity = pale ? "0.4" : "1";
      mark.style.borderTopColor = `var(--${color})`;
      mark.style.borderTopStyle = style ?? "solid";
      line.append(mark, text);
      return line;
    });
    if (this.episode.every > 1) {
      const line = document.createElement("li");
      line.textContent = `of the forecasts one step in ${this.episode.every}`;
      lines.push(line);
    }
    this.part("key").replaceChildren(...lines);
  }

  listen() {
    const on = (name, kind, act) => this.part(name).addEventListener(kind, act);
    on("go", "click", () => this.toggle());
    on("back", "click", () => this.step(-1));
    on("next", "click", () => this.step(1));
    on("time", "input", () => this.show(Number(this.part("time").value)));
    for (const name of ["robot", "zoom", "regions", "each", "plan", "enlarged", "trails"]) {
      on(name, "change", () => this.show(this.index));
    }
    document.addEventListener("keydown", (event) => this.press(event));
    let width = 0;
    new ResizeObserver(() => {
      if (width === this.element.clientWidth) return; // its height is our own doing
      width = this.element.clientWidth;
      requestAnimationFrame(() => this.redraw()); // changes its height, which may not happen here
    }).observe(this.element);
    matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.redraw());
    addEventListener("beforeprint", () => this.redraw());
  }

  press(event) {
    const { target } = event;
    if (!this.episode || event.ctrlKey || event.altKey || event.metaKey) return;
    if (!takesKey(event.key, this.place(target), target.tagName, target.type)) return;
    const speed = this.part("speed"), robot = this.part("robot");
    const faster = (way) => {
      const wanted = speed.selectedIndex + way;
      speed.selectedIndex = Math.min(Math.max(wanted, 0), speed.options.length - 1);
    };
    const acts = {
      " ": () => this.toggle(),
      ArrowRight: () => this.step(1),
      ArrowLeft: () => this.step(-1),
      ArrowUp: () => faster(1),
      ArrowDown: () => faster(-1),
      Home: () => this.show(0),
      End: () => this.show(this.episode.frames.length - 1),
      r: () => {
        robot.selectedIndex = (robot.selectedIndex + 1) % robot.options.length;
        this.show(this.index);
      },
    };
    const act = acts[event.key] ?? acts[event.key.toLowerCase()];
    if (!act) return;
    event.preventDefault();
    act();
  }

  /** Where the focus is. */
  place(target) {
    return target === document.body || this.element.contains(target) ? "own" : "page";
  }

  step(way) {
    this.pause();
    const robot = this.robots[this.part("robot").selectedIndex];
    this.show(decisionFrom(this.episode, robot, this.index, way));
  }

  toggle() {
    if (this.playing) {
      this.pause();
      return;
    }
    const { frames } = this.episode;
    if (this.index === frames.length - 1) this.show(0);
    this.playing = true;
    this.part("go").textContent = "Pause";
    let time = frames[this.index], before;
    const advance = (now) => {
      if (!this.playing) return;
      // Where the slider is moved by hand while it plays, it goes on from there.
      if (this.moved) time = frames[this.index];
      time += Math.min((now - (before ?? now)) / 1000, 0.25) * Number(this.part("speed").value);
      before = now;
      this.show(lastAtMost(frames, time));
      this.moved = false;
      if (this.index === frames.length - 1) this.pause(); else requestAnimationFrame(advance);
    };
    requestAnimationFrame(advance);
  }

  pause() {
    this.playing = false;
    this.part("go").textContent = "Play";
  }

  show(index) {
    this.index = Math.min(Math.max(index, 0), this.episode.frames.length - 1);
    this.moved = true;
    const time = this.episode.frames[this.index], slider = this.part("time");
    slider.value = this.index;
    slider.setAttribute("aria-valuetext", `${time.toFixed(2)} s`);
    const robot = this.robots[this.part("robot").selectedIndex];
    this.tell(facts(this.episode, robot, this.index));
    this.judge(planAt(robot, time));
    if (this.followed !== robot) this.key();
    this.followed = robot;
    this.redraw();
  }

  tell(rows) {
    const list = this.part("facts");
    if (list.children.length !== 2 * rows.length) {
      list.replaceChildren(...rows.flatMap(() => ["dt", "dd"].map((n) => document.createElement(n))));
    }
    rows.flat().forEach((text, i) => {
      if (list.children[i].textContent !== text) list.children[i].textContent = text;
    });
  }

  /** Say how the plan came about, in words and by the colour beside them. */
  judge(plan) {
    const part = this.part("verdict"), words = verdict(plan);
    if (part.textContent !== words) part.textContent = words;
    part.dataset.grade = plan ? grade(plan) : "";
  }

  redraw() {
    if (!this.episode) return;
    const checked = (name) => this.part(name).checked;
    const state = {
      episode: this.episode,
      robot: this.robots[this.part("robot").selectedIndex],
      index: this.index,
      time: this.episode.frames[this.index],
      near: this.part("zoom").value === "near",
      regions: this.part("regions").value,
      each: checked("each") || this.episode.every > 1,
      plan: checked("plan"),
      enlarged: checked("enlarged"),
      trails: checked("trails"),
    };
    const colors = palette(this.element);
    for (const drawn of [...this.views, ...this.charts]) drawn.draw(state, colors);
  }
}

new Player(document.querySelector(".player"));
