// A controller of Nav2 around the exported planner, for Jazzy, Kilted and Lyrical.
//
// It takes the robot's pose and velocity from the controller server, obstacles from a topic, and
// walls from the lethal cells of the local costmap. The planner decides every WIDEBERTH_PLAN_PERIOD
// seconds; in between the command goes on along the ramp that the planner asks for. Near the end of
// the path it slows down, and at the end it turns to the heading of the last pose.
//
// What may be over soon is a NoValidControl: the server then commands zero velocity for up to its
// failure_tolerance. All else ends the goal at once. Configuring fails by a PluginlibException alone,
// the one exception after which the server can be configured again.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>
#include <vector>

#include "geometry_msgs/msg/pose_stamped.hpp"
#include "geometry_msgs/msg/twist_stamped.hpp"
#include "nav2_core/controller.hpp"
#include "nav2_core/controller_exceptions.hpp"
#include "nav_msgs/msg/path.hpp"
#include "pluginlib/class_list_macros.hpp"
#include "pluginlib/exceptions.hpp"
#include "rclcpp/rclcpp.hpp"
#include "rclcpp_lifecycle/lifecycle_node.hpp"

#ifdef WIDEBERTH_NAV2_DYNAMIC_MSGS
#include "nav2_dynamic_msgs/msg/obstacle_array.hpp"
#endif
#ifdef WIDEBERTH_COSTMAP_CONVERTER_MSGS
#include "costmap_converter_msgs/msg/obstacle_array_msg.hpp"
#endif

#include "wideberth_planner.h"

#if __has_include("nav2_ros_common/lifecycle_node.hpp")
#define WIDEBERTH_LYRICAL 1 // the signatures of nav2_core::Controller since Lyrical
#endif

namespace wideberth_nav2
{

#ifdef WIDEBERTH_LYRICAL
using Node = nav2::LifecycleNode;
#else
using Node = rclcpp_lifecycle::LifecycleNode;
#endif

static_assert(
  WIDEBERTH_PLAN_STATES == 5 && WIDEBERTH_STATE_X == 0 && WIDEBERTH_STATE_Y == 1 &&
  WIDEBERTH_STATE_PHI == 2 && WIDEBERTH_STATE_V == 3 && WIDEBERTH_STATE_OMEGA == 4,
  "Nav2 gives pose, forward speed and yaw rate: export the planner of a unicycle");

constexpr double AHEAD = 0.2;       // s, by which a stamp may lie ahead of this clock
constexpr double TOLERANCE = 0.25;  // m, where the goal checker states none: Nav2's
constexpr double SLOW = 0.05;       // m/s; a faster robot goes on into the tolerance, see `look`
constexpr double STANDING = 0.01;   // m/s; a slower robot stands, and may turn on the spot
constexpr double POINT = 1e-3;      // m, length of the path to the place of poses that are all equal

/// Where one frame lies in another, in the plane.
struct Placement
{
  double x = 0.0, y = 0.0, cosine = 1.0, sine = 0.0;

  void move(double * place) const
  {
    const double here[2] = {place[0], place[1]};
    place[0] = x + cosine * here[0] - sine * here[1];
    place[1] = y + sine * here[0] + cosine * here[1];
  }

  /// Turn a covariance, row by row.
  void turn(double * covariance) const
  {
    const double a = covariance[0], b = 0.5 * (covariance[1] + covariance[2]), c = covariance[3];
    covariance[0] = cosine * cosine * a - 2.0 * cosine * sine * b + sine * sine * c;
    covariance[3] = sine * sine * a + 2.0 * cosine * sine * b + cosine * cosine * c;
    covariance[1] = cosine * sine * (a - c) + (cosine * cosine - sine * sine) * b;
    covariance[2] = covariance[1];
  }
};

template<class Quaternion>
double yaw_of(const Quaternion & turn)
{
  return std::atan2(
    2.0 * (turn.w * turn.z + turn.x * turn.y), 1.0 - 2.0 * (turn.y * turn.y + turn.z * turn.z));
}

class Controller : public nav2_core::Controller
{
public:
  void configure(
    const Node::WeakPtr & parent, std::string name, std::shared_ptr<tf2_ros::Buffer> tf,
    std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap) override
  {
    tf_ = tf, costmap_ = costmap;
    try {
      begin(parent.lock(), name);
    } catch (const std::exception & error) {
      cleanup();
      const std::string words = name + " is not configured: " + error.what();
      RCLCPP_ERROR(logger_, "%s", words.c_str());
      throw pluginlib::PluginlibException(words);
    }
  }

  void cleanup() override
  {
    subscription_.reset();
    planner_ = nullptr;
    memory_.clear();
  }

  void activate() override {stand();}
  void deactivate() override {stand();}

  void setSpeedLimit(const double & limit, const bool & percentage) override
  {
    const double stated = percentage ? 0.01 * limit * WIDEBERTH_PLAN_MAX_SPEED : limit;
    fastest_ = limit > 0.0 ? stated : INFINITY; // 0 means no limit
  }

  /// The task is over; what is known of obstacles stays.
  void reset() override {stand();}

#ifdef WIDEBERTH_LYRICAL
  void newPathReceived(const nav_msgs::msg::Path & path) override {follow(path);}

  geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity,
    nav2_core::GoalChecker * checker, const nav_msgs::msg::Path &,
    const geometry_msgs::msg::PoseStamped &) override
  {
    return command(pose, velocity, checker);
  }
#else
  void setPlan(const nav_msgs::msg::Path & path) override {follow(path);}

  geometry_msgs::msg::TwistStamped computeVelocityCommands(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity,
    nav2_core::GoalChecker * checker) override
  {
    return command(pose, velocity, checker);
  }
#endif

private:
  using Detections = std::vector<wideberth_detection>;

  /// Obstacles of the newest message, in its frame.
  struct Received
  {
    std::string frame;
    double stamp = -INFINITY;
    Detections people;
  };

  void begin(const std::shared_ptr<Node> & node, const std::string & name)
  {
    if (!node) {
      throw std::runtime_error("the controller server's node is gone");
    }
    clock_ = node->get_clock();
    logger_ = node->get_logger();
    read_parameters(*node, name);
    memory_.resize(wideberth_planner_size() / sizeof(double) + 1);
    const int status =
      wideberth_planner_begin(memory_.data(), memory_.size() * sizeof(double), &planner_);
    if (status != WIDEBERTH_PLANNED) {
      throw std::runtime_error(wideberth_planner_status_text(status));
    }
    subscribe(node);
  }

  /// A parameter as it is now; after a failed configuration it can be set anew, in another type too.
  template<class T>
  T parameter(Node & node, const std::string & name, const T & usual, const char * words)
  {
    const rclcpp::ParameterValue wanted(usual);
    if (!node.has_parameter(name)) {
      rcl_interfaces::msg::ParameterDescriptor described;
      described.description = std::string(words) + "; read when the controller is configured";
      described.dynamic_typing = true;
      node.declare_parameter(name, wanted, described);
    }
    const auto stated = node.get_parameter(name);
    if (stated.get_type() != wanted.get_type()) {
      const std::string type = rclcpp::to_string(wanted.get_type());
      throw std::invalid_argument(
              name + " is of type " + stated.get_type_name() + "; wanted " + type +
              (type == "double" ? ", with a decimal point as in 1.0" : ""));
    }
    return stated.get_value<T>();
  }

  double number(
    Node & node, const std::string & name, double usual, double least, double most,
    const char * words)
  {
    const double stated = parameter(node, name, usual, words);
    if (!(stated >= least && stated <= most)) {
      throw std::invalid_argument(
              name + " is " + std::to_string(stated) + "; wanted " + std::to_string(least) + " to " +
              std::to_string(most));
    }
    return stated;
  }

  void read_parameters(Node & node, const std::string & name)
  {
    constexpr double some = 1e-3, many = 1e3;
    kind_ = parameter<std::string>(
      node, name + ".obstacles", "nav2_dynamic_msgs",
      "messages of obstacles: nav2_dynamic_msgs, costmap_converter_msgs, or none");
    topic_ = parameter<std::string>(node, name + ".obstacles_topic", "obstacles", "their topic");
    timeout_ = number(
      node, name + ".obstacles_timeout", 1.0, some, WIDEBERTH_PLAN_FORGET,
      "s after which obstacles are too old: the robot stops");
    pose_timeout_ = number(
      node, name + ".pose_timeout", 0.5, some, WIDEBERTH_PLAN_FORGET,
      "s after which the robot's pose is too old: the robot stops");
    radius_ = number(
      node, name + ".obstacle_radius", 0.3, some, many, "m, of obstacles whose size is not stated");
    deviation_ = number(
      node, name + ".obstacle_deviation", 0.05, 0.0, many,
      "m per axis, of places whose covariance is not stated");
    walls_ = parameter(
      node, name + ".walls", true, "whether lethal cells of the local costmap are walls");
    around_ = number(
      node, name + ".clear_around", 0.3, 0.0, many,
      "m around obstacles in which cells are no walls: they are the obstacles themselves");
    tick_ = 1.0 / number(
      node, "controller_frequency", 20.0, some, many, "Hz, of the controller server");
  }

  void subscribe(const std::shared_ptr<Node> & node)
  {
#ifdef WIDEBERTH_NAV2_DYNAMIC_MSGS
    if (kind_ == "nav2_dynamic_msgs") {
      using Message = nav2_dynamic_msgs::msg::ObstacleArray;
      subscription_ = rclcpp::create_subscription<Message>(
        node, topic_, rclcpp::SensorDataQoS(),
        [this](const Message & message) {take(message.header, people_of(message));});
      return;
    }
#endif
#ifdef WIDEBERTH_COSTMAP_CONVERTER_MSGS
    if (kind_ == "costmap_converter_msgs") {
      using Message = costmap_converter_msgs::msg::ObstacleArrayMsg;
      subscription_ = rclcpp::create_subscription<Message>(
        node, topic_, rclcpp::SensorDataQoS(),
        [this](const Message & message) {take(message.header, people_of(message));});
      return;
    }
#endif
    if (kind_ != "none") {
      throw std::invalid_argument(
              "obstacles is " + kind_ + ", which this package was not built with; build it beside "
              "nav2_dynamic_msgs or costmap_converter_msgs, or set obstacles to none");
    }
  }

  template<class Header>
  void take(const Header & header, Detections && people)
  {
    const std::lock_guard<std::mutex> guard(mutex_);
    received_.frame = header.frame_id;
    received_.stamp = rclcpp::Time(header.stamp).seconds();
    received_.people = std::move(people);
  }

  wideberth_detection detection(const std::string & name, double x, double y, double radius) const
  {
    wideberth_detection one{};
    name.copy(one.name, WIDEBERTH_NAME - 1);
    one.position[0] = x, one.position[1] = y;
    one.covariance[0] = one.covariance[3] = deviation_ * deviation_;
    one.radius = radius > 0.0 ? radius : radius_;
    return one;
  }

#ifdef WIDEBERTH_NAV2_DYNAMIC_MSGS
  Detections people_of(const nav2_dynamic_msgs::msg::ObstacleArray & message) const
  {
    Detections found;
    for (const auto & one : message.obstacles) {
      std::string name;
      for (const auto byte : one.uuid.uuid) {
        name += "0123456789abcdef"[byte >> 4], name += "0123456789abcdef"[byte & 15];
      }
      found.push_back(
        detection(name, one.position.x, one.position.y, 0.5 * std::max(one.size.x, one.size.y)));
      const auto & spread = one.position_covariance;
      if (spread[0] > 0.0 && spread[4] > 0.0) {
        const double stated[4] = {spread[0], spread[1], spread[3], spread[4]};
        std::copy(stated, stated + 4, found.back().covariance);
      }
    }
    return found;
  }
#endif

#ifdef WIDEBERTH_COSTMAP_CONVERTER_MSGS
  Detections people_of(const costmap_converter_msgs::msg::ObstacleArrayMsg & message) const
  {
    Detections found;
    for (const auto & one : message.obstacles) {
      const double count = static_cast<double>(one.polygon.points.size());
      double x = 0.0, y = 0.0, reach = 0.0;
      for (const auto & point : one.polygon.points) {
        x += point.x / count, y += point.y / count;
      }
      for (const auto & point : one.polygon.points) {
        reach = std::max(reach, std::hypot(point.x - x, point.y - y));
      }
      if (count > 0.0) {
        found.push_back(detection(std::to_string(one.id), x, y, reach + one.radius));
      }
    }
    return found;
  }
#endif

  /// Where a frame lies in another now.
  Placement placed(const std::string & frame, const std::string & in) const
  {
    Placement found;
    if (frame == in || frame.empty()) {
      return found;
    }
    try {
      const auto stamped = tf_->lookupTransform(in, frame, tf2::TimePointZero);
      const double yaw = yaw_of(stamped.transform.rotation);
      found.x = stamped.transform.translation.x, found.y = stamped.transform.translation.y;
      found.cosine = std::cos(yaw), found.sine = std::sin(yaw);
    } catch (const tf2::TransformException & error) {
      throw nav2_core::ControllerTFError(error.what());
    }
    return found;
  }

  void follow(const nav_msgs::msg::Path & path)
  {
    if (path.poses.empty()) {
      throw nav2_core::InvalidPath("the path has no poses");
    }
    path_ = path;
    new_path_ = true;
  }

  /// Hand the path to the planner, in the frame of the pose.
  void lay(const std::string & frame)
  {
    const Placement placement = placed(path_.header.frame_id, frame);
    const size_t all = path_.poses.size(), stride = (all - 1) / (WIDEBERTH_PATH_POINTS - 1) + 1;
    std::vector<double> points;
    const auto & last = path_.poses.back().pose;
    const double heading = yaw_of(last.orientation);
    heading_ = heading + std::atan2(placement.sine, placement.cosine);
    const bool one_place = std::all_of(
      path_.poses.begin(), path_.poses.end(), [&last](const geometry_msgs::msg::PoseStamped & pose) {
        return pose.pose.position.x == last.position.x && pose.pose.position.y == last.position.y;
      });
    if (one_place) { // start and goal share a cell of the global costmap: only the turn is left
      points = {
        last.position.x - POINT * std::cos(heading), last.position.y - POINT * std::sin(heading),
        last.position.x, last.position.y};
      placement.move(&points[0]), placement.move(&points[2]);
    }
    for (size_t k = 0; k < all && !one_place; k += stride) {
      const auto & place = path_.poses[k + stride < all ? k : all - 1].pose.position;
      points.insert(points.end(), {place.x, place.y});
      placement.move(&points[points.size() - 2]);
    }
    const auto * given = reinterpret_cast<const double(*)[2]>(points.data());
    const int count = static_cast<int>(points.size() / 2);
    const int status = new_path_ ? wideberth_planner_set_path(planner_, given, count) :
      wideberth_planner_move_path(planner_, given, count);
    if (status != WIDEBERTH_PLANNED) {
      throw nav2_core::InvalidPath(wideberth_planner_status_text(status));
    }
    new_path_ = false;
  }

  /// How old something is, s; what is too old, or of a clock that is ahead, cannot be driven by.
  static double age_of(const std::string & what, double stamp, double now, double most)
  {
    const double age = now - stamp;
    if (!(age <= most)) {
      throw nav2_core::NoValidControl(
              std::isfinite(age) ?
              what + " is " + std::to_string(age) + " s old, at most " + std::to_string(most) :
              what + " has not come yet");
    }
    if (age < -AHEAD) {
      throw nav2_core::NoValidControl(
              what + " is stamped " + std::to_string(-age) + " s ahead of this clock, at most " +
              std::to_string(AHEAD) + ": set the clocks alike");
    }
    return std::max(age, 0.0);
  }

  /// The newest message of obstacles, with its age; one without a time of use is an error.
  Received newest(double now)
  {
    Received received;
    if (kind_ == "none") {
      return received;
    }
    {
      const std::lock_guard<std::mutex> guard(mutex_);
      received = received_;
    }
    const double age = age_of("the message on " + topic_, received.stamp, now, timeout_);
    for (auto & one : received.people) {
      one.age = age;
    }
    return received;
  }

  /// Obstacles of a message in a frame; those that have no place there are an error.
  Detections people(Received && received, const std::string & frame) const
  {
    Placement placement;
    try {
      placement = placed(received.frame, frame);
    } catch (const nav2_core::ControllerTFError & error) {
      throw nav2_core::NoValidControl("obstacles cannot be placed: " + std::string(error.what()));
    }
    for (auto & one : received.people) {
      placement.move(one.position);
      placement.turn(one.covariance);
    }
    return std::move(received.people);
  }

  /// Lethal cells of the costmap that are not of the obstacles, as rectangles near the robot.
  std::vector<wideberth_polygon> walls(const double * state, const Detections & people)
  {
    std::vector<wideberth_polygon> found(WIDEBERTH_WALLS);
    if (!walls_ || found.empty()) {
      return {};
    }
    auto * map = costmap_->getCostmap();
    const std::lock_guard<nav2_costmap_2d::Costmap2D::mutex_t> guard(*map->getMutex());
    const int width = static_cast<int>(map->getSizeInCellsX());
    const int height = static_cast<int>(map->getSizeInCellsY());
    const double size = map->getResolution();
    cells_.assign(map->getCharMap(), map->getCharMap() + static_cast<size_t>(width) * height);
    taken_.resize(cells_.size());
    for (const auto & one : people) {
      const double room = one.radius + around_;
      for (int y = 0; y < height; y++) {
        for (int x = 0; x < width; x++) {
          const double off = map->getOriginX() + (x + 0.5) * size - one.position[0];
          const double away = map->getOriginY() + (y + 0.5) * size - one.position[1];
          if (off * off + away * away < room * room) {
            cells_[static_cast<size_t>(y) * width + x] = 0;
          }
        }
      }
    }
    const wideberth_costmap given = {
      cells_.data(), width, height, size, {map->getOriginX(), map->getOriginY()}, 254, 255};
    const int count = wideberth_walls_of(&given, state, taken_.data(), found.data(), WIDEBERTH_WALLS);
    found.resize(static_cast<size_t>(std::clamp(count, 0, WIDEBERTH_WALLS)));
    return found;
  }

  /// Decide; at the end of the path take note of the obstacles alone.
  void decide(const double * state, Detections && seen, double now)
  {
    if (seen.size() > WIDEBERTH_DETECTIONS) {
      const auto nearer = [&state](const wideberth_detection & one, const wideberth_detection & two) {
          return std::hypot(one.position[0] - state[0], one.position[1] - state[1]) <
                 std::hypot(two.position[0] - state[0], two.position[1] - state[1]);
        };
      std::nth_element(seen.begin(), seen.begin() + WIDEBERTH_DETECTIONS, seen.end(), nearer);
      seen.resize(WIDEBERTH_DETECTIONS);
    }
    const auto still = walls(state, seen);
    const wideberth_observation observation = {
      now, state, static_cast<int>(seen.size()), seen.data(), static_cast<int>(still.size()),
      still.data()};
    std::copy(put_out_, put_out_ + 3, begin_);
    decided_ = now;
    if (there_) {
      decision_ = wideberth_decision{};
      wideberth_planner_remember(planner_, &observation);
      return;
    }
    const int status = wideberth_planner_decide(planner_, &observation, &decision_);
    if (status != WIDEBERTH_PLANNED) {
      throw nav2_core::NoValidControl(decision_.reason);
    }
    if (decision_.rung != WIDEBERTH_OPTIMAL) {
      RCLCPP_WARN_THROTTLE(logger_, *clock_, 10000, "%s", decision_.reason);
    }
  }

  /// Look where the robot is on its path, and decide where it is time to.
  void look(
    const geometry_msgs::msg::PoseStamped & pose, const double * state,
    nav2_core::GoalChecker * checker, double now)
  {
    const std::string & frame = pose.header.frame_id;
    age_of("the robot's pose", rclcpp::Time(pose.header.stamp).seconds(), now, pose_timeout_);
    Received received = newest(now);
    const bool due =
      new_path_ || now < decided_ || now - decided_ >= WIDEBERTH_PLAN_PERIOD - 0.5 * tick_;
    if (due) {
      lay(frame);
    }
    geometry_msgs::msg::Pose within;
    geometry_msgs::msg::Twist slow;
    const bool stated =
      checker && checker->getTolerances(within, slow) && within.position.x > 0.0;
    const double tolerance = stated ? within.position.x : TOLERANCE;
    const bool was = there_, is_slow = std::hypot(put_out_[0], put_out_[1]) <= SLOW;
    // well within the tolerance, so that noise of the pose does not take the goal away again
    there_ = wideberth_planner_arrived(planner_, state, (is_slow ? 1.0 : 0.25) * tolerance) != 0;
    if (due || (was && !there_)) {
      decide(state, people(std::move(received), frame), now);
    }
  }

  /// Follow the ramp to a time, more slowly near the end of the path; there stand, and turn.
  void aim(const double * state, double time, double * velocity) const
  {
    if (there_) {
      const bool stands = std::hypot(put_out_[0], put_out_[1]) <= STANDING;
      const double off = std::remainder(heading_ - state[WIDEBERTH_STATE_PHI], 2.0 * M_PI);
      velocity[0] = velocity[1] = 0.0;
      velocity[2] = stands && std::isfinite(off) ? wideberth_spin_rate(off, tick_) : 0.0;
      return;
    }
    const auto & wanted = decision_.command;
    const double target[3] = {wanted.linear[0], wanted.linear[1], wanted.omega};
    const double way = wanted.ramp > 0.0 ? std::min((time - decided_) / wanted.ramp, 1.0) : 1.0;
    for (int k = 0; k < 3; k++) {
      velocity[k] = begin_[k] + way * (target[k] - begin_[k]);
    }
    wideberth_planner_approach(planner_, state, velocity, velocity);
  }

  /// The command a tick from now.
  geometry_msgs::msg::TwistStamped command(
    const geometry_msgs::msg::PoseStamped & pose, const geometry_msgs::msg::Twist & velocity,
    nav2_core::GoalChecker * checker)
  {
    const double now = clock_->now().seconds();
    if (path_.poses.empty()) {
      throw nav2_core::InvalidPath("no path is set");
    }
    const double state[WIDEBERTH_PLAN_STATES] = {
      pose.pose.position.x, pose.pose.position.y, yaw_of(pose.pose.orientation),
      velocity.linear.x, velocity.angular.z};
    try {
      look(pose, state, checker, now);
    } catch (...) {
      stand(); // as the controller server does now
      throw;
    }
    double wanted[3];
    aim(state, now + tick_, wanted);
    wideberth_next_velocity(put_out_, wanted, tick_, put_out_);
    const double speed = std::hypot(put_out_[0], put_out_[1]);
    const double share = speed > fastest_ ? fastest_ / speed : 1.0; // on the same arc
    geometry_msgs::msg::TwistStamped found;
    found.header.stamp = clock_->now();
    found.header.frame_id = costmap_->getBaseFrameID();
    found.twist.linear.x = share * put_out_[0], found.twist.linear.y = share * put_out_[1];
    found.twist.angular.z = share * put_out_[2];
    return found;
  }

  /// Begin the next ramp at a standstill.
  void stand()
  {
    std::fill(put_out_, put_out_ + 3, 0.0);
    decided_ = -INFINITY;
  }

  rclcpp::Clock::SharedPtr clock_;
  rclcpp::Logger logger_ {rclcpp::get_logger("wideberth_nav2")};
  std::shared_ptr<tf2_ros::Buffer> tf_;
  std::shared_ptr<nav2_costmap_2d::Costmap2DROS> costmap_;
  std::string kind_, topic_;
  double timeout_, pose_timeout_, radius_, deviation_, around_, tick_;
  bool walls_;

  std::mutex mutex_; // of what the subscription writes
  Received received_;
  rclcpp::SubscriptionBase::SharedPtr subscription_;

  std::vector<double> memory_;
  wideberth_planner * planner_ = nullptr;
  wideberth_decision decision_{};
  nav_msgs::msg::Path path_;
  bool new_path_ = false, there_ = false;       // whether the robot is at the end of the path
  double heading_ = 0.0;                        // rad, of the path's last pose
  std::vector<unsigned char> cells_, taken_;

  double decided_ = -INFINITY;                  // s, of the last decision
  double begin_[3] = {}, put_out_[3] = {};      // velocities at it, and put out last
  double fastest_ = INFINITY;                   // m/s, the speed limit
};

}  // namespace wideberth_nav2

PLUGINLIB_EXPORT_CLASS(wideberth_nav2::Controller, nav2_core::Controller)
