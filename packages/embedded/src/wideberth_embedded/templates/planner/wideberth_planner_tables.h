/* Made by wideberth; the planner's own files alone include it. */
{% for name, value, text in constants %}
#define PLAN_{{ name }} {{ value }}{{ " /* " ~ text ~ " */" if text }}
{% endfor %}
{% for name, value, text in numbers %}
#define PLAN_{{ name }} {{ value|number|in_brackets }}{{ " /* " ~ text ~ " */" if text }}
{% endfor %}

enum { {{ starts|join(", ") }} };

#if defined(__GNUC__)
#define PLAN_UNUSED __attribute__((unused))
#else
#define PLAN_UNUSED
#endif

{% for one in arrays %}
{{ one }}
{% endfor %}
