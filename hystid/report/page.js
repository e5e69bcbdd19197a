(function () {
  "use strict";
  var narrow = window.matchMedia("(max-width: 760px)");
  var night = window.matchMedia("(prefers-color-scheme: dark)");
  var palettes = JSON.parse(document.getElementById("palettes").textContent);
  var grounds = {
    light: { ground: "#f7f8fa", ink: "#1c2430", card: "#ffffff", grid: "#e8ecf0", edge: "#b9c2cc" },
    dark: { ground: "#1d2630", ink: "#e6ebf1", card: "#171f28", grid: "#2a343f", edge: "#4b5866" }
  };
  var printing = false, hidden = {}, drawings = [];
  var family = "system-ui, -apple-system, Segoe UI, Roboto, Helvetica Neue, Arial, sans-serif";

  function theme() { return night.matches && !printing ? "dark" : "light"; }
  function colour(name) {
    var parts = name.slice(1).split("/"), key = theme();
    var hex = palettes[key][parts[0]] || grounds[key][parts[0]];
    if (!hex) { return name; }
    if (parts.length < 2) { return hex; }
    var rgb = [1, 3, 5].map(function (k) { return parseInt(hex.substr(k, 2), 16); });
    return "rgba(" + rgb.join(",") + "," + parts[1] + ")";
  }
  function bytes(text) {
    var raw = atob(text), out = new Uint8Array(raw.length);
    for (var k = 0; k < raw.length; k++) { out[k] = raw.charCodeAt(k); }
    return out;
  }
  function values(pack) {
    var raw = bytes(pack.q), n = raw.length / 2, out = new Array(n), step = (pack.hi - pack.lo) / 65534;
    var ratio = Math.log(pack.hi / pack.lo) / 65534;
    for (var k = 0; k < n; k++) {
      var level = raw[2 * k] + 256 * raw[2 * k + 1];
      if (level === 65535) { out[k] = null; }
      else { out[k] = pack.log ? pack.lo * Math.exp(ratio * level) : pack.lo + step * level; }
    }
    return out;
  }
  function resolved(item) {
    if (typeof item === "string") { return item.charAt(0) === "@" ? colour(item) : item; }
    if (Array.isArray(item)) { return item.map(resolved); }
    if (item && typeof item === "object") {
      if (item.q !== undefined) { return item.values || (item.values = values(item)); }
      var out = {};
      Object.keys(item).forEach(function (key) { out[key] = key === "meta" ? item[key] : resolved(item[key]); });
      return out;
    }
    return item;
  }
  function role(trace) { return String((trace.line && trace.line.color) || (trace.marker && trace.marker.color) || ""); }
  function styled(layout) {
    var look = grounds[theme()];
    var axis = {
      automargin: true, gridcolor: look.grid, linecolor: look.edge, zerolinecolor: look.edge, ticks: "outside",
      tickcolor: look.edge, ticklen: 4, nticks: narrow.matches || printing ? 5 : 8, exponentformat: "power", showexponent: "all",
      hoverformat: ".5g"
    };
    var all = Object.assign({
      font: { family: family, size: 12.5, color: look.ink }, paper_bgcolor: look.card, plot_bgcolor: look.card,
      margin: { l: 12, r: 14, t: 18, b: 12, pad: 0 }, hovermode: "closest", dragmode: narrow.matches ? false : "zoom",
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1.02, yanchor: "bottom", font: { size: 12 }, itemsizing: "constant" },
      bargap: 0.25, hoverlabel: { font: { size: 12 } }, uirevision: "kept"
    }, layout);
    all.xaxis = Object.assign({}, axis, layout.xaxis);
    all.yaxis = Object.assign({}, axis, layout.yaxis);
    [all.xaxis, all.yaxis].forEach(function (one) {
      if (one.type === "category") { delete one.nticks; }
      if (one.type === "log") { one.title = Object.assign({ standoff: 8 }, one.title); }  // its labels are wider than plotly thinks
    });
    if (narrow.matches || printing) { all.height = Math.min(layout.height, 320); }
    return all;
  }
  function sheet(place) {  // width on paper in pixels, for two columns of a page; CSS fits it to the sheet
    var figure = place.closest("figure");
    return figure.matches(".grid.one > *, .grid > :last-child:nth-child(odd)") ? 640 : 310;
  }
  function scalable(place) {  // so that CSS can change the size of what is drawn
    place.querySelectorAll(".main-svg").forEach(function (svg) {
      svg.setAttribute("viewBox", "0 0 " + svg.getAttribute("width") + " " + svg.getAttribute("height"));
    });
  }
  function draw(place, figure) {
    var layout = styled(resolved(figure.layout)), width = printing ? sheet(place) : place.clientWidth;
    var most = Math.max(18, Math.floor(width / 9));  // letters that a legend has room for
    var shown = figure.data.map(function (trace) {
      var name = trace.name && trace.name.length > most ? trace.name.slice(0, most - 1) + "\u2026" : trace.name;
      return Object.assign(resolved(trace), { visible: !hidden[role(trace)], name: name });
    });
    if (printing) { layout.width = width; }
    return Plotly.react(place, shown, layout, {
      responsive: true, displaylogo: false, displayModeBar: place.clientWidth > 440 ? "hover" : false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"]
    }).then(function () { if (printing) { scalable(place); } });
  }

  function linked(holder) {
    var data = JSON.parse(holder.querySelector(".linked-data").textContent);
    var places = Array.prototype.slice.call(holder.querySelectorAll(".plot"));
    var slider = holder.querySelector("input"), said = holder.querySelector("output"), now = data.first;
    function figure(view) {
      var x = view.x[now];
      var traces = view.series.map(function (one) {
        return {
          type: "scatter", mode: one.dots ? "markers" : "lines", name: one.name, x: x, y: one.y[now],
          line: { color: one.role, width: 1.4 }, marker: { color: one.role, size: 3.5, opacity: 0.75 }
        };
      });
      traces.push({
        type: "scatter", mode: "markers", x: [], y: [], hoverinfo: "skip", showlegend: false,
        marker: { color: "@card", size: 11, line: { color: "@bad", width: 2.5 } }
      });
      return {
        data: traces,
        layout: {
          height: 320, showlegend: view.series.length > 1,
          xaxis: { title: { text: view.xtitle } }, yaxis: { title: { text: view.ytitle } }
        }
      };
    }
    function all() {
      return Promise.all(places.map(function (place, k) { return draw(place, figure(data.views[k])); }));
    }
    function mark(index) {
      places.forEach(function (place, k) {
        var view = data.views[k], at = index === null ? null : resolved(view.x[now])[index];
        var top = index === null ? null : resolved(view.series[0].y[now])[index];
        var last = view.series.length;
        Plotly.restyle(place, { x: [at === null ? [] : [at]], y: [at === null ? [] : [top]] }, [last]);
      });
    }
    function listen() {
      places.forEach(function (place) {
        place.on("plotly_hover", function (event) { mark(event.points[0].pointIndex); });
        place.on("plotly_click", function (event) { mark(event.points[0].pointIndex); });
        place.on("plotly_unhover", function () { mark(null); });
      });
      if (slider) {
        slider.addEventListener("input", function () {
          now = Number(slider.value);
          said.textContent = data.spans[now];
          all();
        });
      }
    }
    drawings.push(all);
    return all().then(listen);
  }

  function again() { return Promise.all(drawings.map(function (one) { return one(); })); }
  function begin() {
    var first = [];
    document.querySelectorAll("script.figure").forEach(function (holder) {
      var figure = JSON.parse(holder.textContent), place = holder.previousElementSibling;
      var one = function () { return draw(place, figure); };
      drawings.push(one);
      first.push(one());
    });
    document.querySelectorAll(".linked").forEach(function (holder) { first.push(linked(holder)); });
    document.querySelectorAll(".tools button").forEach(function (button) {
      button.addEventListener("click", function () {
        var off = button.getAttribute("aria-pressed") === "true";
        button.setAttribute("aria-pressed", String(!off));
        hidden[button.dataset.role] = off;
        again();
      });
    });
    night.addEventListener("change", again);
    window.addEventListener("beforeprint", function () { printing = true; again(); });
    window.addEventListener("afterprint", function () {
      printing = false;
      again().then(function () { document.querySelectorAll(".plot").forEach(function (one) { Plotly.Plots.resize(one); }); });
    });
    return Promise.all(first);
  }
  function fail(error) {
    document.querySelectorAll(".plot").forEach(function (place) {
      place.textContent = "The figures need a browser of 2023 or later (" + error + ").";
    });
    document.documentElement.setAttribute("data-drawn", "no");
  }
  var packed = document.getElementById("plotly").textContent;
  Promise.resolve().then(function () {
    var stream = new Blob([bytes(packed)]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Response(stream).text();
  }).then(function (code) {
    var script = document.createElement("script");
    script.textContent = code;
    document.head.appendChild(script);
    return begin();
  }).then(function () { document.documentElement.setAttribute("data-drawn", "yes"); }).catch(fail);
})();
