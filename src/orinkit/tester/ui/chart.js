// A plot (ECharts). The library is loaded after the page has been displayed, because it is large.
export default {
  template: "<div></div>",
  props: { options: Object },
  mounted() {
    this.waiting = [];
    this.observer = new ResizeObserver(() => this.chart?.resize());
    requestAnimationFrame(() => setTimeout(() => this.load()));
  },
  beforeUnmount() {
    this.observer.disconnect();
    this.chart?.dispose();
  },
  methods: {
    async load() {
      const { echarts } = await import("nicegui-echart");
      if (!this.$el?.isConnected) return;
      this.chart = echarts.init(this.$el);
      this.chart.setOption(JSON.parse(JSON.stringify(this.options)));
      this.waiting.splice(0).forEach(([patch, replaced]) => this.change(patch, replaced));
      this.observer.observe(this.$el);
    },
    change(patch, replaced) {
      if (this.chart) this.chart.setOption(patch, { replaceMerge: replaced });
      else this.waiting.push([patch, replaced]);
    },
  },
};
