// As much of Nav2's controller server as a goal meets: configuration, the control loop with its
// goal and progress checkers and its failure_tolerance, and the codes of its results. The robot
// does what it is commanded. Usage: SCENARIO NUMBER..., see `main`; or load LIBRARY... CLASS...
#include <dlfcn.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>

#include "nav2_stub.hpp"

namespace
{
constexpr double TICK = 0.05;
constexpr const char * PLUGIN = "wideberth_nav2::Controller";
enum Code
{
  SUCCESS = 0, UNKNOWN = 100, TF = 102, PATH = 103, PATIENCE = 104, PROGRESS = 105, CONTROL = 106
};

geometry_msgs::msg::Quaternion turned(double yaw)
{
  return {0.0, 0.0, std::sin(0.5 * yaw), std::cos(0.5 * yaw)};
}

double apart(double one, double two) {return std::fabs(std::remainder(one - two, 2.0 * M_PI));}

/// A server with one controller, and the robot that it drives in the frame "odom".
struct Server
{
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> node =
    std::make_shared<rclcpp_lifecycle::LifecycleNode>();
  std::shared_ptr<tf2_ros::Buffer> tf = std::make_shared<tf2_ros::Buffer>();
  std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap =
    std::make_shared<nav2_costmap_2d::Costmap2DROS>();
  std::unique_ptr<nav2_core::Controller> controller;
  nav2_core::GoalChecker checker;
  double tolerance = 1.0;  // failure_tolerance, s
  double x = 0.0, y = 0.0, heading = 0.0, travelled = 0.0, swept = 0.0;
  geometry_msgs::msg::Twist moving;

  std::function<void(Server &)> before = [](Server &) {};  // each tick
  bool frozen = false;                                     // odometry and tf
  double ahead = 0.0;                                      // s, of the pose's stamp
  geometry_msgs::msg::PoseStamped pose;
  geometry_msgs::msg::Twist measured;
  std::string reason;
  int zeros = 0;

  double now() const {return node->clock->seconds;}

  /// Whether the lifecycle transition succeeds; what it may not throw ends the process.
  bool configure(const std::string & name)
  {
    controller = pluginlib::known().at(name)();
    try {
      controller->configure(node, "FollowPath", tf, costmap);
    } catch (const pluginlib::PluginlibException &) {
      controller.reset();
      return false;
    }
    controller->activate();
    return true;
  }

  void see(double px, double py, double stamp, const std::string & frame = "odom")
  {
    nav2_dynamic_msgs::msg::ObstacleArray message;
    nav2_dynamic_msgs::msg::Obstacle one;
    one.position = {px, py, 0.0}, one.size = {0.6, 0.6, 1.8}, one.uuid.uuid[3] = 200;
    one.position_covariance[0] = one.position_covariance[4] = 4e-4;
    message.header.frame_id = frame, message.header.stamp = rclcpp::Time(stamp);
    message.obstacles.push_back(one);
    node->callback(&message);
  }

  void measure()
  {
    if (frozen) {return;}
    pose.header.frame_id = "odom", pose.header.stamp = rclcpp::Time(now() + ahead);
    pose.pose.position = {x, y, 0.0}, pose.pose.orientation = turned(heading);
    measured = moving;
  }

  geometry_msgs::msg::Twist compute()
  {
#if __has_include("nav2_ros_common/lifecycle_node.hpp")
    return controller->computeVelocityCommands(pose, measured, &checker, {}, {}).twist;
#else
    return controller->computeVelocityCommands(pose, measured, &checker).twist;
#endif
  }

  void move()
  {
    const double middle = heading + 0.5 * TICK * moving.angular.z;
    x += TICK * moving.linear.x * std::cos(middle), y += TICK * moving.linear.x * std::sin(middle);
    heading += TICK * moving.angular.z;
    travelled += TICK * std::fabs(moving.linear.x), swept += TICK * std::fabs(moving.angular.z);
    node->clock->seconds += TICK;
  }

  void take(const nav_msgs::msg::Path & path)
  {
#if __has_include("nav2_ros_common/lifecycle_node.hpp")
    controller->newPathReceived(path);
#else
    controller->setPlan(path);
#endif
  }

  bool reached(const geometry_msgs::msg::Pose & goal, double yaw) const
  {
    return std::hypot(goal.position.x - x, goal.position.y - y) <= checker.xy &&
           apart(yaw, heading) <= checker.yaw;
  }

  int loop(const nav_msgs::msg::Path & path, double yaw)
  {
    double valid = now(), px = x, py = y, turn = heading, progress = now();
    take(path);
    while (true) {
      before(*this);
      measure();
      if (std::hypot(x - px, y - py) > 0.5 || apart(heading, turn) > 0.3) {
        px = x, py = y, turn = heading, progress = now();
      }
      if (now() - progress > 10.0) {return PROGRESS;}
      try {
        moving = compute();
        valid = now();
      } catch (const nav2_core::NoValidControl & error) {
        if (tolerance <= 0.0) {throw;}
        reason = error.what(), moving = {}, zeros++;
        if (now() - valid > tolerance) {return PATIENCE;}
      }
      move();
      if (reached(path.poses.back().pose, yaw)) {return SUCCESS;}
    }
  }

  /// Drive a goal, and write how it ended: code, s, place, heading, m and rad on the way, ticks of
  /// zero velocity, reason.
  void drive(const nav_msgs::msg::Path & path, double yaw)
  {
    const double begin = now();
    int code = SUCCESS;
    try {
      code = loop(path, yaw);
    } catch (const nav2_core::ControllerTFError & error) {
      code = TF, reason = error.what();
    } catch (const nav2_core::NoValidControl & error) {
      code = CONTROL, reason = error.what();
    } catch (const nav2_core::InvalidPath & error) {
      code = PATH, reason = error.what();
    } catch (const nav2_core::ControllerException & error) {
      code = UNKNOWN, reason = error.what();
    }
    controller->reset();
    std::printf(
      "%d %.3f %.9f %.9f %.9f %.9f %.9f %d %s\n", code, now() - begin, x, y, heading, travelled,
      swept, zeros, reason.c_str());
    moving = {};
  }
};

nav_msgs::msg::Path straight(double length, double yaw, double step = 0.05)
{
  nav_msgs::msg::Path path;
  path.header.frame_id = "odom";
  for (int k = 0; k <= std::lround(length / step); k++) {
    path.poses.emplace_back();
    path.poses.back().pose.position = {k * step, 0.0, 0.0};
  }
  path.poses.back().pose.orientation = turned(yaw);
  return path;
}

/// The same pose, so many times.
nav_msgs::msg::Path there(double x, double yaw, int count)
{
  nav_msgs::msg::Path path;
  path.header.frame_id = "odom";
  path.poses.resize(static_cast<size_t>(count));
  for (auto & one : path.poses) {
    one.pose.position = {x, 0.0, 0.0}, one.pose.orientation = turned(yaw);
  }
  return path;
}

/// Configure with parameters one after the other on one server; write what each attempt does.
void configurations()
{
  Server server;
  const auto attempt = [&server](const char * words) {
      std::printf("%s: %s\n", words, server.configure(PLUGIN) ? "configured" : "failed");
    };
  auto & given = server.node->overrides;
  auto & set = server.node->parameters;
  given["FollowPath.obstacles_timeout"] = int64_t{1};
  given["FollowPath.obstacles"] = std::string("nav2_dynamic_msgs");
  attempt("integer");
  attempt("integer again");
  for (const double wrong : {-1.0, 0.0, 3.5, double(INFINITY), double(NAN)}) {
    set["FollowPath.obstacles_timeout"] = wrong;
    attempt("out of range");
  }
  set["FollowPath.obstacles_timeout"] = 1.0;
  set["FollowPath.obstacles"] = std::string("costmap_converter_msgs");
  attempt("not built");
  set["FollowPath.obstacles"] = true;
  attempt("bool");
  set["FollowPath.obstacles"] = std::string("none");
  set["FollowPath.pose_timeout"] = -1.0;
  attempt("pose");
  set["FollowPath.pose_timeout"] = 0.5;
  set["FollowPath.obstacle_radius"] = -0.3;
  attempt("radius");
  set["FollowPath.obstacle_radius"] = 0.3;
  attempt("right");
  std::shared_ptr<rclcpp_lifecycle::LifecycleNode> gone;
  std::swap(server.node, gone);
  attempt("node gone");
  std::swap(server.node, gone);
  attempt("right again");
  server.drive(straight(2.0, 0.0), 0.0);
}

/// Load plug-ins, and let their controllers drive in turns: a row per tick.
void load(char ** files, char ** names, int count)
{
  std::vector<Server> servers(static_cast<size_t>(count));
  for (int k = 0; k < count; k++) {
    if (!dlopen(files[k], RTLD_NOW | RTLD_GLOBAL)) {std::printf("%s\n", dlerror()), std::exit(1);}
  }
  for (int k = 0; k < count; k++) {
    servers[k].node->parameters["FollowPath.obstacles"] = std::string("nav2_dynamic_msgs");
    if (!servers[k].configure(names[k])) {std::exit(1);}
    servers[k].take(straight(6.0, 0.0));
  }
  for (int tick = 0; tick < 150; tick++) {
    for (auto & server : servers) {
      server.see(3.0, 1.5 - 0.2 * server.now(), server.now());
      server.measure();
      server.moving = server.compute();
      server.move();
      std::printf("%.17g %.17g ", server.moving.linear.x, server.moving.angular.z);
    }
    std::printf("\n");
  }
}
}  // namespace

int main(int count, char ** words)
{
  const std::string scenario = words[1];
  const auto number = [&](int k) {return k < count ? std::strtod(words[k], nullptr) : 0.0;};
  if (scenario == "load") {
    const int libraries = (count - 2) / 2;
    load(words + 2, words + 2 + libraries, libraries);
    return 0;
  }
  if (scenario == "configure") {
    configurations();
    return 0;
  }
  Server server;
  server.node->parameters["FollowPath.obstacles"] = std::string("nav2_dynamic_msgs");
  if (!server.configure(PLUGIN)) {return 1;}
  server.node->clock->seconds = 100.0;
  const auto in_view = [](Server & one) {one.see(2.0, 6.0, one.now());};
  server.before = in_view;
  if (scenario == "heading") { // YAW: of the last pose
    server.drive(straight(3.0, number(2)), number(2));
    server.drive(there(server.x, 0.0, 1), 0.0);  // and back, where it stands
  } else if (scenario == "point") { // X YAW POSES: at one place
    server.drive(there(number(2), number(3), static_cast<int>(number(4))), number(3));
  } else if (scenario == "frozen") { // FROM UNTIL TOLERANCE, s: odometry and tf stand still
    server.tolerance = number(4);
    server.before = [&](Server & one) {
        in_view(one);
        one.frozen = one.now() >= 100.0 + number(2) && one.now() < 100.0 + number(3);
      };
    server.drive(straight(6.0, 0.0), 0.0);
  } else if (scenario == "stamped") { // POSE OBSTACLES, s: by how much their stamps are ahead
    server.ahead = number(2);
    server.before = [&](Server & one) {one.see(2.0, 6.0, one.now() + number(3));};
    server.drive(straight(3.0, 0.0), 0.0);
  } else if (scenario == "silent") { // FROM UNTIL TOLERANCE, s: no obstacles come
    server.tolerance = number(4);
    server.before = [&](Server & one) {
        if (one.now() < 100.0 + number(2) || one.now() >= 100.0 + number(3)) {in_view(one);}
      };
    server.drive(straight(6.0, 0.0), 0.0);
  } else if (scenario == "placeless") { // their frame is not known
    server.before = [](Server & one) {one.see(2.0, 6.0, one.now(), "nowhere");};
    server.drive(straight(3.0, 0.0), 0.0);
  } else if (scenario == "passing") { // X Y VX VY: a person who walks
    server.before = [&](Server & one) {
        const double since = one.now() - 100.0;
        one.see(number(2) + since * number(4), number(3) + since * number(5), one.now());
      };
    server.drive(straight(6.0, 0.0), 0.0);
  } else {
    return 2;
  }
  return 0;
}
