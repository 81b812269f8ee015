// As much of ROS 2 and Nav2 as the exported controller names, in place of their headers.
#pragma once
#include <array>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <variant>
#include <vector>

namespace builtin_interfaces::msg { struct Time { int32_t sec = 0; uint32_t nanosec = 0; }; }
namespace std_msgs::msg { struct Header { builtin_interfaces::msg::Time stamp; std::string frame_id; }; }

namespace geometry_msgs::msg
{
struct Point { double x = 0.0, y = 0.0, z = 0.0; };
using Vector3 = Point;
struct Point32 { float x = 0.0F, y = 0.0F, z = 0.0F; };
struct Quaternion { double x = 0.0, y = 0.0, z = 0.0, w = 1.0; };
struct Pose { Point position; Quaternion orientation; };
struct PoseStamped { std_msgs::msg::Header header; Pose pose; };
struct Twist { Vector3 linear, angular; };
struct TwistStamped { std_msgs::msg::Header header; Twist twist; };
struct Polygon { std::vector<Point32> points; };
struct Transform { Vector3 translation; Quaternion rotation; };
struct TransformStamped { Transform transform; };
}  // namespace geometry_msgs::msg

namespace nav_msgs::msg
{
struct Path { std_msgs::msg::Header header; std::vector<geometry_msgs::msg::PoseStamped> poses; };
}

namespace unique_identifier_msgs::msg { struct UUID { std::array<uint8_t, 16> uuid{}; }; }

namespace nav2_dynamic_msgs::msg
{
struct Obstacle
{
  unique_identifier_msgs::msg::UUID uuid;
  geometry_msgs::msg::Point position;
  geometry_msgs::msg::Vector3 size;
  std::array<double, 9> position_covariance{};
};
struct ObstacleArray { std_msgs::msg::Header header; std::vector<Obstacle> obstacles; };
}  // namespace nav2_dynamic_msgs::msg

namespace costmap_converter_msgs::msg
{
struct ObstacleMsg { geometry_msgs::msg::Polygon polygon; double radius = 0.0; int64_t id = 0; };
struct ObstacleArrayMsg { std_msgs::msg::Header header; std::vector<ObstacleMsg> obstacles; };
}  // namespace costmap_converter_msgs::msg

namespace rcl_interfaces::msg
{
struct ParameterDescriptor
{
  std::string description;
  bool read_only = false, dynamic_typing = false;
};
}

namespace rclcpp
{
class Time
{
public:
  explicit Time(double seconds) : seconds_(seconds) {}
  explicit Time(const builtin_interfaces::msg::Time & time)
  : seconds_(time.sec + 1e-9 * time.nanosec) {}
  double seconds() const {return seconds_;}
  operator builtin_interfaces::msg::Time() const
  {
    const auto whole = static_cast<int32_t>(seconds_);
    return {whole, static_cast<uint32_t>(1e9 * (seconds_ - whole))};
  }

private:
  double seconds_;
};

struct Clock
{
  using SharedPtr = std::shared_ptr<Clock>;
  double seconds = 0.0;
  Time now() const {return Time(seconds);}
};

struct Logger {};
inline Logger get_logger(const std::string &) {return {};}
struct SensorDataQoS {};
struct SubscriptionBase { using SharedPtr = std::shared_ptr<SubscriptionBase>; };

using Value = std::variant<bool, int64_t, double, std::string>;
enum ParameterType {PARAMETER_BOOL, PARAMETER_INTEGER, PARAMETER_DOUBLE, PARAMETER_STRING};
inline std::string to_string(ParameterType type)
{
  return std::array{"bool", "integer", "double", "string"}[type];
}
struct ParameterValue
{
  Value value;
  explicit ParameterValue(const Value & given) : value(given) {}
  ParameterType get_type() const {return static_cast<ParameterType>(value.index());}
};
struct Parameter
{
  Value value;
  ParameterType get_type() const {return ParameterValue(value).get_type();}
  std::string get_type_name() const {return to_string(get_type());}
  template<class T> T get_value() const {return std::get<T>(value);}
};
}  // namespace rclcpp

#define RCLCPP_WARN_THROTTLE(logger, clock, ...) (void)(logger), (void)(clock)
#define RCLCPP_ERROR(logger, ...) (void)(logger), std::printf("ERROR "), \
  std::printf(__VA_ARGS__), std::printf("\n")

namespace rclcpp_lifecycle
{
struct LifecycleNode
{
  using WeakPtr = std::weak_ptr<LifecycleNode>;
  std::map<std::string, rclcpp::Value> parameters, overrides;
  std::function<void(const void *)> callback;  // of the one subscription
  rclcpp::Clock::SharedPtr clock = std::make_shared<rclcpp::Clock>();

  rclcpp::Clock::SharedPtr get_clock() {return clock;}
  rclcpp::Logger get_logger() {return {};}
  bool has_parameter(const std::string & name) {return parameters.count(name) > 0;}
  rclcpp::Parameter get_parameter(const std::string & name) {return {parameters.at(name)};}
  void declare_parameter(
    const std::string & name, const rclcpp::ParameterValue & usual,
    const rcl_interfaces::msg::ParameterDescriptor & described)
  {
    const auto stated = overrides.find(name);
    const auto & value = stated == overrides.end() ? usual.value : stated->second;
    if (value.index() != usual.value.index() && !described.dynamic_typing) {
      throw std::runtime_error("parameter '" + name + "' has invalid type");
    }
    parameters[name] = value;
  }
};
}  // namespace rclcpp_lifecycle

namespace nav2 { using LifecycleNode = rclcpp_lifecycle::LifecycleNode; }

namespace rclcpp
{
template<class Message, class Node, class Callback>
SubscriptionBase::SharedPtr create_subscription(
  Node & node, const std::string &, const SensorDataQoS &, Callback && callback)
{
  node->callback = [callback](const void * message) {
      callback(*static_cast<const Message *>(message));
    };
  return std::make_shared<SubscriptionBase>();
}
}  // namespace rclcpp

namespace tf2
{
struct TransformException : std::runtime_error { using std::runtime_error::runtime_error; };
constexpr int TimePointZero = 0;
}  // namespace tf2

namespace tf2_ros
{
struct Buffer
{
  std::map<std::string, geometry_msgs::msg::TransformStamped> known;  // "target source"
  geometry_msgs::msg::TransformStamped lookupTransform(
    const std::string & target, const std::string & source, int) const
  {
    const auto found = known.find(target + " " + source);
    if (found == known.end()) {throw tf2::TransformException("no transform");}
    return found->second;
  }
};
}  // namespace tf2_ros

namespace nav2_costmap_2d
{
struct Costmap2D
{
  using mutex_t = std::recursive_mutex;
  mutex_t mutex;
  unsigned int width = 0, height = 0;
  double resolution = 0.1, x = 0.0, y = 0.0;
  std::vector<unsigned char> cells;
  mutex_t * getMutex() {return &mutex;}
  unsigned int getSizeInCellsX() const {return width;}
  unsigned int getSizeInCellsY() const {return height;}
  double getResolution() const {return resolution;}
  double getOriginX() const {return x;}
  double getOriginY() const {return y;}
  unsigned char * getCharMap() {return cells.data();}
};
struct Costmap2DROS
{
  Costmap2D map;
  Costmap2D * getCostmap() {return &map;}
  std::string getBaseFrameID() const {return "base_link";}
};
}  // namespace nav2_costmap_2d

namespace nav2_core
{
struct GoalChecker
{
  double xy = 0.25, yaw = 0.25;
  bool getTolerances(geometry_msgs::msg::Pose & pose, geometry_msgs::msg::Twist &)
  {
    pose.position = {xy, xy, 0.0};
    return true;
  }
};
struct ControllerException : std::runtime_error { using std::runtime_error::runtime_error; };
struct ControllerTFError : ControllerException { using ControllerException::ControllerException; };
struct InvalidPath : ControllerException { using ControllerException::ControllerException; };
struct NoValidControl : ControllerException { using ControllerException::ControllerException; };

class Controller
{
public:
  virtual ~Controller() = default;
  virtual void configure(
    const rclcpp_lifecycle::LifecycleNode::WeakPtr &, std::string, std::shared_ptr<tf2_ros::Buffer>,
    std::shared_ptr<nav2_costmap_2d::Costmap2DROS>) = 0;
  virtual void cleanup() = 0;
  virtual void activate() = 0;
  virtual void deactivate() = 0;
  virtual void setSpeedLimit(const double &, const bool &) = 0;
  virtual void reset() {}
#if __has_include("nav2_ros_common/lifecycle_node.hpp")
  virtual void newPathReceived(const nav_msgs::msg::Path &) = 0;
  virtual geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped &, const geometry_msgs::msg::Twist &, GoalChecker *,
    const nav_msgs::msg::Path &, const geometry_msgs::msg::PoseStamped &) = 0;
#else
  virtual void setPlan(const nav_msgs::msg::Path &) = 0;
  virtual geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped &, const geometry_msgs::msg::Twist &, GoalChecker *) = 0;
#endif
};
}  // namespace nav2_core

namespace pluginlib
{
struct PluginlibException : std::runtime_error { using std::runtime_error::runtime_error; };

/// Classes of all libraries of the process, by name; two of one name are an error.
inline auto & known()
{
  static std::map<std::string, std::function<std::unique_ptr<nav2_core::Controller>()>> classes;
  return classes;
}
inline int enter(const std::string & name, std::function<std::unique_ptr<nav2_core::Controller>()> make)
{
  if (!known().emplace(name, make).second) {throw PluginlibException(name + " is there twice");}
  return 0;
}
}  // namespace pluginlib

#define PLUGINLIB_EXPORT_CLASS(own, base) \
  namespace {const int entered = pluginlib::enter(#own, [] {return std::make_unique<own>();});}
