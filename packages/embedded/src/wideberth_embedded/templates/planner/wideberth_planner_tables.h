{% macro nested(values) %}
{% if values is sequence %}{{ "{" }}{% for one in values %}{{ nested(one) }}{{ ", " if not loop.last }}{% endfor %}{{ "}" }}{% else %}{{ values|number }}{% endif %}
{% endmacro %}
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

{% for name, sizes, values in arrays %}
static const double PLAN_{{ name }}{{ sizes }} PLAN_UNUSED = {{ nested(values) }};
{% endfor %}
{% for name, words in choices %}
static const int PLAN_{{ name }}[] PLAN_UNUSED = { {{- words|join(", ") or "0" -}} };
{% endfor %}
