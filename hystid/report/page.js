(function () {
  "use strict";
  var narrow = window.matchMedia("(max-width: 760px)");
  var font = { family: "system-ui, -apple-system, Segoe UI, Roboto, Helvetica Neue, Arial, sans-serif", size: 12.5, color: "#1c2430" };
  var axis = {
    automargin: true, gridcolor: "#e8ecf0", linecolor: "#b9c2cc", zerolinecolor: "#cfd6dd", ticks: "outside",
    tickcolor: "#b9c2cc", ticklen: 4, nticks: 8, exponentformat: "power", showexponent: "all", hoverformat: ".5g"
  };
  function styled(layout) {
    var base = {
      font: font, paper_bgcolor: "#ffffff", plot_bgcolor: "#ffffff", margin: { l: 12, r: 14, t: 18, b: 12, pad: 0 },
      hovermode: "closest", dragmode: narrow.matches ? false : "zoom",
      legend: { orientation: "h", x: 0, xanchor: "left", y: 1.02, yanchor: "bottom", font: { size: 12 } },
      bargap: 0.25, hoverlabel: { font: { size: 12 } }
    };
    var all = Object.assign(base, layout);
    all.xaxis = Object.assign({}, axis, layout.xaxis);
    all.yaxis = Object.assign({}, axis, layout.yaxis);
    [all.xaxis, all.yaxis].forEach(function (one) { if (one.type === "category") { delete one.nticks; } });
    if (narrow.matches) { if (all.xaxis.nticks) { all.xaxis.nticks = 5; } all.height = Math.min(layout.height, 320); }
    return all;
  }
  document.querySelectorAll("script.figure").forEach(function (holder) {
    var figure = JSON.parse(holder.textContent);
    var place = holder.previousElementSibling;
    Plotly.newPlot(place, figure.data, styled(figure.layout), {
      responsive: true, displaylogo: false, displayModeBar: place.clientWidth > 440 ? "hover" : false,
      modeBarButtonsToRemove: ["select2d", "lasso2d", "autoScale2d"]
    });
  });
  document.documentElement.setAttribute("data-drawn", "yes");
})();
