classdef deadline < handle
    % The end of a wait. Where time is simulated it is over when so much of the robot's time has gone by, too.

    properties (Access = private)
        bridge
        name
        timeout
        left   % s of real time until we look again
        begun
        first  % the robot's time then
        last
    end

    methods

        function self = deadline(bridge, name, timeout)
            % In `timeout` s; `name`: whose record tells the robot's time.
            self.bridge = bridge;
            self.name = name;
            self.timeout = timeout;
            self.left = timeout;
            if ~strcmp(bridge.clock, 'wall')
                self.first = self.robot_time();
                self.last = -Inf;
            end
            self.begun = tic;
        end

        function over = is_over(self)
            % Whether it is past.
            over = toc(self.begun) >= self.left;
            if ~over || strcmp(self.bridge.clock, 'wall')
                return
            end
            now_s = self.robot_time();
            over = now_s - self.first >= self.timeout || now_s <= self.last;
            self.last = now_s;
            self.left = max(self.timeout - (now_s - self.first), 1);  % by then a robot that lives shows it
            self.begun = tic;
        end

    end

    methods (Access = private)

        function now_s = robot_time(self)
            row = self.bridge.read([self.name '/state']);
            now_s = row.stamp_ns * 1e-9;
        end

    end

end
